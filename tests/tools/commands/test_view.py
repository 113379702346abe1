import json
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path
from time import sleep
from typing import Any
from urllib.request import urlopen

import imagecodecs
import numpy as np
import pytest

from panchroma.shared import read_dng
from tests.browser import Browser
from tests.tools.capture.test_viewfinder import codes, pictures
from tests.tools.command import ended, start
from tests.tools.commands.test_capture import LINE, MOVING, SLIPPED, moving

NOISE = "--size 30x20 --pixel-format u16 --sensor-bits 10 --unchecked"


@contextmanager
def viewing(*arguments: str | Path, source: str = "builtin:192x128@20") -> Iterator[Any]:
    """`panchroma view` in a process of its own, and the address of its page."""
    line = ("view", source, "--bind", "127.0.0.1:0", *arguments)
    with start(*line, stdin=subprocess.PIPE) as process:
        try:
            said = process.stdout.readline()
            address = re.search(r"http://127\.0\.0\.1:\d+/", said)
            assert address, said
            yield process, address[0]
        finally:
            process.kill()  # the test failed, or it has ended


def wait_for_pictures(url: str, number: int) -> None:
    """Wait until so many have been shown: a frame that comes before the one before it is shown
    takes its place.
    """
    for _ in range(600):
        with urlopen(f"{url}status", timeout=60) as answer:
            if json.load(answer)["frames"] >= number:
                return
        sleep(0.1)
    pytest.fail(f"{number} pictures are not shown")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_ends_it_while_somebody_watches(number: signal.Signals, code: int) -> None:
    with viewing() as (process, url):
        host, _, port = url.removeprefix("http://").rstrip("/").partition(":")
        connection = HTTPConnection(host, int(port), timeout=60)
        connection.request("GET", "/stream.mjpg")
        stream = pictures(connection.getresponse())
        assert imagecodecs.jpeg8_decode(next(stream)).shape == (128, 192, 3)
        assert ended(process, number, code=code).err == ""


def test_a_camera_that_ends_ends_it() -> None:
    with viewing(NOISE, source="-") as (process, url):
        for number in (1, 2):
            os.write(process.stdin.fileno(), codes(0).tobytes())
            wait_for_pictures(url, number)
        told = ended(process, code=1).err  # its standard input is closed
    assert "the camera has ended after 2 pictures; start it again" in told


def test_a_stream_that_slips_ends_it() -> None:
    frames = moving(5)
    with viewing(MOVING, source="-") as (process, _):
        with suppress(BrokenPipeError):
            process.stdin.buffer.write(b"".join([*frames, frames[0][LINE:], *frames, *frames]))
        assert SLIPPED in ended(process, code=1).err


def test_a_stalled_camera_s_picture_and_figures_are_shown(tmp_path: Path) -> None:
    """To whoever comes after its last frame, too."""
    with Browser(tmp_path / "profile") as browser, viewing(NOISE, source="-") as (process, url):
        browser.open(url)
        browser.until("document.body?.dataset.state === 'waiting'")
        for number in range(2):
            frame = np.maximum(codes(number), 1023 * number).astype("<u2")
            os.write(process.stdin.fileno(), frame.tobytes())
            wait_for_pictures(url, number + 1)
        browser.until("document.body.dataset.state === 'silent'")
        for _ in range(2):
            assert browser.until("picture.naturalWidth") == 30
            browser.until("clipped.textContent === '100 %' && rate.textContent === '0.0'")
            browser.open(url)  # again
            browser.until("document.body?.dataset.state === 'silent'")
        ended(process, signal.SIGINT, code=130)
        browser.until("document.body.dataset.state === 'lost'")
        assert browser.evaluate("rate.textContent") == "–"


@pytest.mark.parametrize(("width", "height"), [(1280, 860), (390, 844)])
def test_in_a_browser(tmp_path: Path, out: Path, width: int, height: int) -> None:
    """The picture comes and moves, figures are there, the button saves, nothing sticks out, and a
    lost camera is told.
    """
    profile = tmp_path / "profile"
    with Browser(profile, width, height) as browser, viewing("-o", out) as (process, url):
        browser.open(url)
        browser.until("document.body?.dataset.state === 'live'")
        assert browser.evaluate("picture.naturalWidth") == 192
        assert float(browser.until("rate.textContent !== '0.0' && rate.textContent")) > 0
        assert re.fullmatch(r"\d+ ms", browser.evaluate("latency.textContent"))
        assert browser.evaluate("dropped.textContent").isdigit()
        assert browser.evaluate("size.textContent") == "192 × 128"
        root = "document.documentElement"
        assert browser.evaluate(f"{root}.scrollWidth <= innerWidth")
        assert browser.evaluate(f"{root}.scrollHeight <= innerHeight")

        browser.until("getComputedStyle(picture).opacity === '1'")  # it fades in
        place = "(({x, y, width, height}) => ({x, y, width, height, scale: 1}))"
        box = browser.evaluate(f"{place}(picture.getBoundingClientRect())")
        one = imagecodecs.png_decode(browser.screenshot(box))
        moved = (imagecodecs.png_decode(browser.screenshot(box)) != one for _ in range(50))
        assert any(changed.mean() > 0.1 for changed in moved)

        browser.until("!shutter.disabled")
        browser.evaluate("shutter.click()")
        told = browser.until("message.textContent")
        (shot,) = out.iterdir()
        assert told.startswith(f"✓ {shot.name}")
        assert read_dng(shot).shape == (128, 192)

        assert ended(process, signal.SIGINT, code=130).err == ""
        browser.until("document.body.dataset.state === 'lost'")
        assert browser.evaluate("shutter.disabled")
