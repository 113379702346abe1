"""Measure the camera's path from end to end, 12 megapixels a frame: python -m
tests.benchmarks.camera [FIGURE]...

live     `panchroma view` takes frames from a pipe, and a browser's part, a client that only reads,
receives the JPEGs. saving   the same, while shots are saved. stages   processor time of each step
from the raw bytes to the JPEG, and of a saved shot, one thread, one after the other.

The frames are made before the clock starts, and numbered by marks in a corner, so that each JPEG
tells which frame it shows. A frame that is due while the one before is still being written is lost,
as in a camera. Latency is from the first byte written to the last byte of the JPEG received. `view`
runs with the default options in a process of its own; camera and client share its cores.
"""

import argparse
import json
import os
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from statistics import median

import imagecodecs
import numpy as np

from panchroma.device import Preview
from panchroma.device.capture import Sensor
from panchroma.device.capture.frames import FORMATS, FrameLayout, RawFrame
from panchroma.device.capture.loop import SteadyWhite
from panchroma.shared import ByteArray, CfaPattern, SensorCalibration
from panchroma.shared.dng import encode_dng
from panchroma.tools.capture.viewfinder import encode_view
from tests.benchmarks.harness import Frame, Work, alternate
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


def asked(port: int, path: str, method: str = "GET") -> HTTPResponse:
    """The answer of `view`."""
    connection = HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request(method, path)
    return connection.getresponse()


def measure(name: str, rate: float, seconds: float, shots: float, options: list[str]) -> None:
    """Run `view` on frames of a format, `rate` a second, and save `shots` a second."""
    layout, frames = camera_frames(name)
    sensor = f"--width {WIDTH} --height {HEIGHT} --pixel-format {name} --stride {layout.stride}"
    with tempfile.TemporaryDirectory() as folder:
        folders = ["-o", folder] if shots else []
        bits = ("--sensor-bits", str(BITS[name]))
        command = [*sensor.split(), *bits, "--port", "0", *folders, *options]
        reading, writing = os.pipe()
        process = start("view", "-", *command, stdin=reading)
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
        before = _counts(process.pid, port, camera, client)
        began = time.monotonic()
        saved = _shoot(port, shots, began + seconds) if shots else []
        time.sleep(max(began + seconds - time.monotonic(), 0))
        lasted = time.monotonic() - began
        after = _counts(process.pid, port, camera, client)
        camera.stopping = True
        _, errors = process.communicate(timeout=60)
        if process.returncode:
            sys.exit(f"view failed: {errors}")
        sizes = [path.stat().st_size for path in Path(folder).glob("*.dng")]
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
    if shots:
        took = np.array([seconds for ok, seconds in saved if ok])
        print(
            f"  {len(took) / lasted:.2f} DNGs a second ({np.mean(sizes) / 1e6:.1f} MB), "
            f"{np.median(took):.2f} s each, {len(saved) - len(took)} not saved"
        )


def _counts(pid: int, port: int, camera: Camera, client: Client) -> dict[str, float]:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    view = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    dropped = json.load(asked(port, "/status"))["dropped"]
    taken, shown = len(camera.started), len(client.received)
    return {"view": view, "taken": taken, "lost": camera.lost, "shown": shown, "dropped": dropped}


def _shoot(port: int, rate: float, until: float) -> list[tuple[bool, float]]:
    """Press the button `rate` times a second; (whether a shot was saved, seconds that the answer
    took) of each.
    """
    answers, due = [], time.monotonic()
    while (begun := time.monotonic()) < until:
        answer = asked(port, "/capture", "POST")
        answer.read()
        answers.append((answer.status == 200, time.monotonic() - begun))
        due += 1 / rate
        time.sleep(max(due - time.monotonic(), 0))
    return answers


def stages(name: str, rounds: int = 9) -> None:
    """Print the processor time of each step."""
    layout, frames = camera_frames(name)
    calibration = SensorCalibration.of_bits(BITS[name], headroom=False)
    sensor = Sensor(layout, CfaPattern.bayer(), calibration)
    data = memoryview(frames[0].tobytes())
    frame = RawFrame.now(data)
    mosaic = sensor.mosaic(frame)
    balance = SteadyWhite()
    preview = Preview.for_mosaic(mosaic, 3, threads=1)
    picture = preview.run(mosaic)
    balanced = balance(mosaic)

    print(f"{name}, processor time of a frame")
    works: dict[str, Work] = {
        "receiving (one copy)": lambda: bytearray(data),
        "unpacking, mosaic": lambda: sensor.mosaic(frame),
        "white balance": lambda: balance(mosaic),
        "preview, 1 : 3": lambda: preview.run(balanced),
        "JPEG": lambda: encode_view(picture),  # type: ignore[arg-type]
        "a shot beside it, as DNG": lambda: encode_dng(balanced, picture),  # type: ignore[arg-type]
    }
    times = alternate(works, rounds, time.process_time)
    steps = {title: median(seconds) for title, seconds in times.items()}
    *parts, beside = (f"  {title:<36}{1e3 * seconds:7.1f} ms" for title, seconds in steps.items())
    total, cores = sum(list(steps.values())[:-1]), os.cpu_count() or 1
    shown = f"{cores} cores could show {cores / total:.0f} a second"
    print(*parts, f"  {'all':<36}{1e3 * total:7.1f} ms: {shown}", beside, sep="\n")


def main() -> None:
    """Print the chosen figures, by default all."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    figures = "live, saving or stages; default: all"
    parser.add_argument("figures", nargs="*", metavar="FIGURE", help=figures)
    formats = "format of the frames (default u16)"
    parser.add_argument("--format", default="u16", choices=FORMATS, help=formats)
    parser.add_argument("--rate", type=float, help="frames a second (default 30, saving 20)")
    parser.add_argument("--shots", type=float, default=2.0, help="shots a second (default 2)")
    seconds = "how long each measurement lasts (default 15)"
    parser.add_argument("--seconds", type=float, default=15.0, help=seconds)
    given, options = parser.parse_known_args()
    for figure in given.figures or ("live", "saving", "stages"):
        if figure == "stages":
            stages(given.format)
        elif figure == "live":
            measure(given.format, given.rate or 30, given.seconds, 0, options)
        else:
            measure(given.format, given.rate or 20, given.seconds, given.shots, options)


if __name__ == "__main__":
    main()
