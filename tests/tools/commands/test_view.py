import ctypes
import os
import re
import signal
import subprocess
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import imagecodecs
import pytest

from shared import read_dng
from tests.browser import Browser
from tests.tools.command import start
from tests.tools.live.test_viewfinder import codes, pictures


class Command:
    """`panchroma view` in a process of its own."""

    def __init__(self, *arguments: str, source: str = "builtin:192x128@20", stdin: Any = subprocess.DEVNULL) -> None:
        self.process = start("view", source, "--port", "0", *arguments, stdin=stdin)
        line = self.process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+/", line)
        assert found, line
        self.url = found[0]

    def end(self, number: signal.Signals = signal.SIGINT) -> tuple[int, str]:
        """Exit code and what was said on the way out."""
        self.process.send_signal(number)
        return self.wait()

    def wait(self) -> tuple[int, str]:
        _, told = self.process.communicate(timeout=60)
        return self.process.returncode, told

    def __enter__(self) -> "Command":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:  # the test failed
            self.process.kill()
            self.process.communicate()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
@pytest.mark.parametrize("thread", ["main", "another"])
def test_a_signal_ends_it_while_somebody_watches(number: signal.Signals, code: int, thread: str) -> None:
    with Command() as command:
        host, _, port = command.url.removeprefix("http://").rstrip("/").partition(":")
        connection = HTTPConnection(host, int(port), timeout=60)
        connection.request("GET", "/stream.mjpg")
        stream = pictures(connection.getresponse())
        assert imagecodecs.jpeg8_decode(next(stream)).shape == (128, 192, 3)
        pid = command.process.pid
        others = (int(task.name) for task in Path(f"/proc/{pid}/task").iterdir() if task.name != str(pid))
        assert ctypes.CDLL(None).tgkill(pid, pid if thread == "main" else next(others), number) == 0
        assert command.wait() == (code, "")


def test_a_camera_that_breaks_off_ends_it() -> None:
    data = codes(0).tobytes() + b"12345"
    options = ["--width", "30", "--height", "20", "--pixel-format", "u16", "--sensor-bits", "10"]
    reading, writing = os.pipe()
    with Command(*options, source="-", stdin=reading) as command:
        os.close(reading)
        os.write(writing, data)
        os.close(writing)
        code, told = command.wait()
    assert code == 1
    assert "ended in the middle of a frame, 5 bytes after 1 whole ones" in told


@pytest.mark.parametrize(("width", "height", "dark"), [(1280, 860, False), (390, 844, True)])
def test_in_a_browser(tmp_path: Path, out: Path, width: int, height: int, dark: bool) -> None:
    """The picture comes and moves, figures are there, the button saves, nothing sticks out, and a lost camera is told."""
    with Browser(tmp_path / "profile", width, height, dark=dark) as browser, Command("-o", str(out)) as command:
        browser.open(command.url)
        browser.until("document.body?.dataset.state === 'live'")
        assert browser.evaluate("picture.naturalWidth") == 192
        assert float(browser.until("rate.textContent !== '0.0' && rate.textContent")) > 0
        assert re.fullmatch(r"\d+ ms", browser.evaluate("latency.textContent"))
        assert browser.evaluate("dropped.textContent").isdigit()
        assert browser.evaluate("size.textContent") == "192 × 128"
        assert browser.evaluate(
            "document.documentElement.scrollWidth <= innerWidth && document.documentElement.scrollHeight <= innerHeight"
        )

        ground = browser.evaluate("getComputedStyle(document.body).backgroundColor")
        assert ground == ("rgb(18, 18, 18)" if dark else "rgb(233, 233, 233)")
        browser.until("getComputedStyle(picture).opacity === '1'")  # it fades in
        box = browser.evaluate("(({x, y, width, height}) => ({x, y, width, height, scale: 1}))(picture.getBoundingClientRect())")
        one = imagecodecs.png_decode(browser.screenshot(box))
        assert one[..., :3].std(axis=(0, 1)).min() > 20  # a scene, not a ground
        moved = (imagecodecs.png_decode(browser.screenshot(box)) != one for _ in range(50))
        assert any(changed.mean() > 0.1 for changed in moved)

        browser.until("!shutter.disabled")
        browser.evaluate("shutter.click()")
        told = browser.until("message.textContent")
        (shot,) = out.iterdir()
        assert told.startswith(f"✓ {shot.name}")
        assert read_dng(shot).shape == (128, 192)

        assert command.end() == (130, "")
        browser.until("document.body.dataset.state === 'lost'")
        assert browser.evaluate("shutter.disabled")
