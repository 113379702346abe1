"""Measure the camera's path from end to end, 12 megapixels a frame: python -m
tests.benchmarks.camera [--format u16] [--rate 30] [--seconds 15] [option of `view` ...]

`panchroma view` takes frames from a pipe, and a browser's part, a client that only reads, receives
the JPEGs.

The frames are made before the clock starts, and numbered by marks in a corner, so that each JPEG
tells which frame it shows. A frame that is due while the one before is still being written is lost,
as in a camera. Latency is from the first byte written to the last byte of the JPEG received. `view`
runs with the default options in a process of its own; camera and client share its cores.
"""

import argparse
import json
import os
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path

import imagecodecs
import numpy as np

from panchroma.device.capture.frames import FORMATS, FrameLayout
from panchroma.shared import ByteArray
from tests.benchmarks.harness import Frame
from tests.device.packer import pack
from tests.tools.command import start

WIDTH, HEIGHT, BITS = 4056, 3040, {"u16": 12, "raw12": 12, "raw10": 10}
STRIDES = {"u16": 8128, "raw12": 6112, "raw10": 5120}  # of an IMX477 on a Raspberry Pi
FRAMES, WARM = 4, 3.0  # different frames; seconds before the measurement
MARK, MARKS = 48, 12  # rows of a mark and bytes of a line; bits of a frame's number
# bytes of a dark mark, and of a bright one
BRIGHT = {"u16": (0x01, 0x0B), "raw12": (0x10, 0xB0), "raw10": (0x10, 0xB0)}


def camera_frames(name: str) -> tuple[FrameLayout, list[ByteArray]]:
    """The layout, and frames as bytes (H, stride)."""
    layout = FrameLayout(WIDTH, HEIGHT, name, STRIDES[name])
    codes = (Frame((HEIGHT + 8, WIDTH)).shot.codes >> (12 - BITS[name])).astype(np.uint16)
    # as many whole groups of pixels are as many whole bytes
    lines = np.frombuffer(pack(codes[:HEIGHT], name), np.uint8).reshape(HEIGHT, layout.line_bytes)
    step = 96 * layout.line_bytes // WIDTH
    padding = ((0, 0), (0, layout.stride - layout.line_bytes))
    return layout, [np.pad(np.roll(lines, step * k, axis=1), padding) for k in range(FRAMES)]


@dataclass
class Camera:
    """Writes frames into a pipe, `rate` a second, in a thread.

    started: when the writing of each frame began, by number, seconds.
    lost: frames that were due while another was written.
    """

    layout: FrameLayout
    frames: list[ByteArray]
    rate: float
    pipe: int
    started: dict[int, float] = field(default_factory=dict)
    lost: int = 0
    stopping: bool = False

    def run(self) -> None:
        number, due = 0, time.monotonic()
        with suppress(BrokenPipeError):
            while not self.stopping:
                frame = self.frames[number % FRAMES]
                self._mark(frame, number)
                time.sleep(max(due - time.monotonic(), 0))
                self.started[number] = time.monotonic()
                data = frame.data.cast("B")
                while data:
                    data = data[os.write(self.pipe, data) :]
                number += 1
                due += 1 / self.rate
                while due < time.monotonic() - 0.5 / self.rate:
                    due += 1 / self.rate
                    self.lost += 1
        os.close(self.pipe)

    def _mark(self, frame: ByteArray, number: int) -> None:
        marks = np.array(BRIGHT[self.layout.format], np.uint8)[number >> np.arange(MARKS) & 1]
        frame[:MARK, : MARKS * MARK * 2] = np.repeat(marks, MARK * 2)


@dataclass
class Client:
    """Reads the stream of JPEGs in a thread, and keeps them. received: (time, JPEG) of each."""

    port: int
    received: list[tuple[float, bytes]] = field(default_factory=list)

    def run(self) -> None:
        stream = asked(self.port, "/stream.mjpg")
        while line := stream.readline():
            if line.startswith(b"Content-Length: "):
                stream.readline()
                jpeg = stream.read(int(line[16:]))
                self.received.append((time.monotonic(), jpeg))

    def number(self, jpeg: bytes, layout: FrameLayout) -> int:
        """The frame's number, modulo 2**MARKS."""
        picture = imagecodecs.jpeg8_decode(jpeg)
        pixels = MARK * 2 * picture.shape[1] / layout.line_bytes  # of a mark
        centres = ((np.arange(MARKS) + 0.5) * pixels).astype(int)
        return int((picture[4:9, centres, 1].mean(axis=0) > 100) @ (1 << np.arange(MARKS)))


def asked(port: int, path: str) -> HTTPResponse:
    """The answer of `view`."""
    connection = HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", path)
    return connection.getresponse()


def measure(name: str, rate: float, seconds: float, options: list[str]) -> None:
    """Run `view` on frames of a format, `rate` a second."""
    layout, frames = camera_frames(name)
    sensor = f"--size {WIDTH}x{HEIGHT} --pixel-format {name} --stride {layout.stride}"
    bits = f"--sensor-bits {BITS[name]}"
    reading, writing = os.pipe()
    process = start("view", "-", sensor, bits, "--bind 127.0.0.1:0", *options, stdin=reading)
    os.close(reading)
    camera = Camera(layout, frames, rate, writing)
    for line in process.stdout:
        if "http://" in line:
            port = int(line.rstrip("/\n").rpartition(":")[2])
            break
    else:
        sys.exit("view did not start")
    client = Client(port)
    for end in (camera, client):
        threading.Thread(target=end.run, daemon=True).start()
    time.sleep(WARM)
    before, began = _counts(process.pid, port, camera, client), time.monotonic()
    time.sleep(seconds)
    lasted = time.monotonic() - began
    after = _counts(process.pid, port, camera, client)
    process.terminate()
    _, errors = process.communicate(timeout=60)
    camera.stopping = True
    if process.returncode:
        sys.exit(f"view failed: {errors}")
    rates = {key: (after[key] - before[key]) / lasted for key in after}
    views = [(when, jpeg) for when, jpeg in client.received if began <= when <= began + lasted]
    late = []
    for when, jpeg in views:
        number = client.number(jpeg, layout)
        number += round((max(camera.started) - number) / (1 << MARKS)) << MARKS
        late.append(when - camera.started[number])
    middle, slowest = 1e3 * np.quantile(late, (0.5, 0.99))
    size = np.mean([len(jpeg) for _, jpeg in views]) / 1e3
    print(
        f"{name}, {layout.frame_bytes / 1e6:.1f} MB a frame, {rate:g} offered a second: "
        f"{rates['taken']:.1f} taken, {rates['shown']:.1f} shown as JPEG ({size:.0f} kB), "
        f"{rates['dropped']:.1f} dropped by view, {rates['lost']:.1f} by the camera, which had to "
        f"wait\n  latency {middle:.0f} ms, 99 % {slowest:.0f} ms\n"
        f"  cores used by view: {rates['view']:.2f}"
    )


def _counts(pid: int, port: int, camera: Camera, client: Client) -> dict[str, float]:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    view = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    dropped = json.load(asked(port, "/status"))["dropped"]
    taken, shown = len(camera.started), len(client.received)
    return {"view": view, "taken": taken, "lost": camera.lost, "shown": shown, "dropped": dropped}


def main() -> None:
    """Print the figures."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    formats = "format of the frames (default u16)"
    parser.add_argument("--format", default="u16", choices=FORMATS, help=formats)
    rate = "frames a second (default 30)"
    parser.add_argument("--rate", type=float, default=30.0, help=rate)
    seconds = "how long the measurement lasts (default 15)"
    parser.add_argument("--seconds", type=float, default=15.0, help=seconds)
    given, options = parser.parse_known_args()
    measure(given.format, given.rate, given.seconds, options)


if __name__ == "__main__":
    main()
