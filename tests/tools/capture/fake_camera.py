"""Aravis' own GigE Vision camera, alone with its clients in a network of its own: no packet leaves
the machine, no port is taken.

The library is called by ctypes: the program under test has its own way to it. Registers are those
of arvfakecamera.h.
"""

import ctypes
import fcntl
import json
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

LIBRARY = "libaravis-0.8.so.0"
ALONE = ("unshare", "--map-root-user", "--net")
_WIDTH, _HEIGHT, _FORMAT = 0x100, 0x104, 0x128
_FILL = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, *[ctypes.c_uint32] * 3)
_DECIBELS = "<Value>0</Value><Min>0</Min><Max>48</Max><Unit>dB</Unit>"
_GAIN = f'<Float Name="Gain" NameSpace="Standard">{_DECIBELS}</Float>'


class FakeCamera:
    """A camera that sends one frame again and again.

    folder: for its files. size: rows, columns. name, code: its format's, see PFNC. lost: packets of
    1000 that it loses. `beside` is what a command has to be started with, to be in the same
    network.
    """

    def __init__(
        self, folder: Path, size: tuple[int, int], name: str, code: int, frame: bytes, lost: int = 0
    ) -> None:
        (folder / "frame").write_bytes(frame)
        facts = json.dumps([str(folder), *size, name, code, lost])
        command = [*ALONE, sys.executable, __file__, facts]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self.process.stdout.readline() == b"up\n"
        namespaces = ("--user", "--net", "--preserve-credentials")
        self.beside = ("nsenter", "--target", str(self.process.pid), *namespaces)

    def kill(self) -> None:
        """As if somebody had pulled its plug."""
        self.process.kill()
        self.process.communicate()


def serve(folder: Path, height: int, width: int, name: str, code: int, lost: int) -> None:
    """Be that camera for two minutes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:  # SIOCSIFFLAGS: up
        fcntl.ioctl(any_socket, 0x8914, struct.pack("16sh22x", b"lo", 1))
    aravis, frame = ctypes.CDLL(LIBRARY), (folder / "frame").read_bytes()
    for function in (
        aravis.arv_fake_camera_new,
        aravis.arv_fake_camera_get_genicam_xml,
        aravis.arv_gv_fake_camera_new,
        aravis.arv_gv_fake_camera_get_fake_camera,
        aravis.arv_buffer_get_data,
    ):
        function.restype = ctypes.c_void_p
    size = ctypes.c_size_t()
    described = ctypes.c_void_p(aravis.arv_fake_camera_new(b"described"))
    address = aravis.arv_fake_camera_get_genicam_xml(described, ctypes.byref(size))
    xml = ctypes.string_at(address, size.value).decode()
    if name != "Mono8":
        entry = f'<EnumEntry Name="{name}" NameSpace="Standard"><Value>{code}</Value></EnumEntry>'
        xml = xml.replace('<EnumEntry Name="Mono8"', f'{entry}<EnumEntry Name="Mono8"', 1)
    (folder / "camera.xml").write_text(xml.replace("<Category", f"{_GAIN}<Category", 1))
    aravis.arv_set_fake_camera_genicam_filename(str(folder / "camera.xml").encode())
    camera = ctypes.c_void_p(aravis.arv_gv_fake_camera_new(b"127.0.0.1", b"GV01"))
    objects = ctypes.CDLL("libgobject-2.0.so.0")
    objects.g_object_set(camera, b"gvsp-lost-ratio", ctypes.c_double(lost / 1000), None)
    sensor = ctypes.c_void_p(aravis.arv_gv_fake_camera_get_fake_camera(camera))
    for register, value in ((_WIDTH, width), (_HEIGHT, height), (_FORMAT, code)):
        aravis.arv_fake_camera_write_register(sensor, register, value)

    def fill(buffer: int, *_: Any) -> None:
        place = aravis.arv_buffer_get_data(ctypes.c_void_p(buffer), ctypes.byref(size))
        ctypes.memmove(place, frame, len(frame))

    callback = _FILL(fill)  # kept: the library calls it
    aravis.arv_fake_camera_set_fill_pattern(sensor, callback, None)
    print("up", flush=True)
    time.sleep(120)


if __name__ == "__main__":
    where, *camera_facts = json.loads(sys.argv[1])
    serve(Path(where), *camera_facts)
