import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection, HTTPResponse, RemoteDisconnected
from itertools import cycle
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import imagecodecs
import numpy as np
import pytest

from panchroma.device.capture import PreviewMaker, Sensor
from panchroma.device.capture.frames import FrameLayout, RawFrame
from panchroma.device.capture.shots import ShotFolder
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, read_dng
from panchroma.shared.arrays import ByteArray
from panchroma.shared.dng import read_preview
from panchroma.shared.errors import InputError, OutputError
from panchroma.tools.capture import viewfinder
from panchroma.tools.capture.server import ViewfinderServer
from panchroma.tools.capture.viewfinder import Viewfinder, fitting_scale
from tests.device.packer import random_codes
from tests.tools.command import names

SIZE = (20, 30)
PROXY = "camera.example.org"
SENSOR = Sensor(
    FrameLayout(SIZE[1], SIZE[0], "u16"),
    CfaPattern.bayer(),
    SensorCalibration(black_level=(0.0,) * 4, white_level=1023),
)


def even(mosaic: Mosaic) -> ByteArray:
    """A small picture, which says of which frame it is."""
    return np.full((5, 7, 3), int(mosaic.codes[0, 0]) >> 2, np.uint8)


def noise(mosaic: Mosaic) -> ByteArray:
    """A large picture, for a small frame: some 4 MB of JPEG."""
    random = np.random.default_rng(int(mosaic.codes[0, 0]))
    return random.integers(0, 256, (1500, 2000, 3), np.uint8)


def codes(number: int) -> Any:
    return random_codes(SIZE, 10, number)


def show(
    finder: Viewfinder, number: int, preview: PreviewMaker = even, samples: Any = None
) -> None:
    """Show random codes, or these samples."""
    frame = RawFrame.now((codes(number) if samples is None else samples).tobytes())
    mosaic = SENSOR.mosaic(frame)
    finder.show(preview(mosaic), mosaic, frame)


class Served:
    """A viewfinder at work, which a proxy may pass on."""

    def __init__(self, folder: Path) -> None:
        self.finder = Viewfinder(lambda: 7, ShotFolder(folder))
        self.faults: list[BaseException] = []
        address, hosts = ("127.0.0.1", 0), (PROXY, "gate.example")
        self.server = ViewfinderServer(address, self.finder, self.faults.append, hosts)
        self.port = int(self.server.server_address[1])

    def ask(self, path: str, method: str = "GET", **headers: str) -> HTTPResponse:
        connection = HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request(method, path, headers=headers)
        return connection.getresponse()

    def facts(self, path: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, Any]]:
        answer = self.ask(path, method, **headers)
        return answer.status, json.loads(answer.read())


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    running = Served(tmp_path)
    with running.server as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield running
        running.finder.close()
        server.shutdown()


@pytest.fixture
def shown(served: Served) -> Served:
    """One that shows a picture."""
    show(served.finder, 0)
    return served


def pictures(stream: HTTPResponse) -> Iterator[bytes]:
    """The JPEG files of a multipart stream (RFC 2046)."""
    kind = stream.headers["Content-Type"]
    match = re.fullmatch(r"multipart/x-mixed-replace; boundary=(\w+)", kind)
    assert match, kind
    boundary = b"--" + match[1].encode() + b"\r\n"
    assert stream.readline() == boundary
    while True:
        head = {}
        while line := stream.readline().strip():
            name, _, value = line.partition(b": ")
            head[name] = value
        assert head[b"Content-Type"] == b"image/jpeg"
        yield stream.read(int(head[b"Content-Length"]))
        assert stream.readline() == b"\r\n"
        assert stream.readline() == boundary


def test_frames_are_shown_in_their_order_without_those_that_do_not_fit_until_the_end() -> None:
    shown, refused, pauses = list[int](), list[InputError](), cycle((0.01, 0.0, 0.0))

    def show(_: ByteArray, mosaic: Mosaic, __: RawFrame) -> None:
        time.sleep(next(pauses))
        shown.append(int(mosaic.codes[0, 0]))

    def frames() -> Iterator[RawFrame]:
        for number in range(20):
            yield RawFrame.now(codes(number).tobytes()[: None if number != 2 else -1])
        raise InputError("the stream broke")

    with pytest.raises(InputError, match="the stream broke"):
        Viewfinder.show_frames(Mock(show=show), frames(), SENSOR, even, refused.append)
    assert shown == [int(codes(number)[0, 0]) for number in range(20) if number != 2]
    assert len(refused) == 1


def test_the_figures(served: Served) -> None:
    status, none = served.facts("/status")
    assert (status, none["frames"], none["fps"], none["silent"]) == (200, 0, 0, True)
    samples = np.full(SIZE, 500, "<u2")
    samples[:, :15] = 1023
    for number in range(3):
        show(served.finder, number, samples=samples)
    _, facts = served.facts("/status")
    assert min(facts["fps"], facts["latency_ms"]) > 0
    known = {"frames": 3, "width": 30, "height": 20, "clipped": 0.5, "dropped": 7, "can_save": True}
    assert known.items() <= facts.items()


@pytest.mark.parametrize(("interval", "rate"), [(0.05, 20.0), (2.5, 0.4), (30.0, 1 / 30)])
def test_a_camera_is_silent_by_its_own_interval(
    monkeypatch: pytest.MonkeyPatch, interval: float, rate: float
) -> None:
    now = 100.0
    monkeypatch.setattr(viewfinder, "monotonic", lambda: now)
    finder = Viewfinder(lambda: 0)
    for number in range(5):
        now += interval
        show(finder, number)
        now += 0.9 * interval
        assert not finder.status()["silent"]
        now -= 0.9 * interval
    assert finder.status()["fps"] == pytest.approx(rate)
    now += max(2.0, 2.5 * interval) + 0.01
    assert finder.status()["silent"]
    assert finder.status()["fps"] == 0.0


def test_the_button_saves_the_frame_shown_and_its_picture(served: Served, tmp_path: Path) -> None:
    for number in range(3):
        show(served.finder, number)
    for _ in range(2):
        status, facts = served.facts("/capture", "POST", Origin=f"http://127.0.0.1:{served.port}")
        assert status == 200
        assert np.array_equal(read_dng(tmp_path / facts["file"]).codes, codes(2))
        picture = imagecodecs.jpeg8_decode(read_preview(tmp_path / facts["file"]))
        assert picture.shape == (5, 7, 3)
        assert abs(picture - codes(2)[0, 0] / 4).max() < 3
    assert len(list(tmp_path.iterdir())) == 2


def test_what_cannot_be_saved_is_told(
    served: Served, tmp_path: Path, full_disk: Callable[[], None]
) -> None:
    none = {"error": "there is no frame: the camera has not begun, or has ended"}
    assert served.facts("/capture", "POST") == (409, none)
    show(served.finder, 0)
    full_disk()
    status, facts = served.facts("/capture", "POST")
    assert status == 507
    assert "the disk is full" in facts["error"]
    assert str(tmp_path) not in facts["error"]
    assert list(tmp_path.iterdir()) == []


HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'.*frame-ancestors 'none'",
}
PAGES = {
    "/": "text/html",
    "/?again": "text/html",
    "/style.css": "text/css",
    "/script.js": ".*/javascript",
}


@pytest.mark.parametrize("path", PAGES)
def test_the_page_is_for_this_site_alone(served: Served, path: str) -> None:
    """Its links are relative, so that a proxy may serve it below a path."""
    answer = served.ask(path)
    assert answer.status == 200
    for name, value in (HEADERS | {"Content-Type": PAGES[path]}).items():
        assert re.match(value, answer.headers[name]), name
    text = answer.read()
    assert len(text) == int(answer.headers["Content-Length"])
    assert not re.search(rb"""(src|href)="(/|http)|fetch\("(/|http)|src = `(/|http)""", text)


REQUESTS = [("GET", "/"), ("GET", "/status"), ("GET", "/stream.mjpg"), ("POST", "/capture")]
OWN = ["127.0.0.1", "localhost:8000", "LOCALHOST", "[::1]:8000", "192.168.1.7:8000"]
OWN += [socket.gethostname(), PROXY.upper(), f"{PROXY}:443"]
# An attacker's page reaches this server under the attacker's name: DNS rebinding.
FOREIGN = ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "", "[::1"]
FOREIGN += [f"{PROXY}.evil.example", f"x.{PROXY}", "example.org", "."]
ORIGINS = ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}"]
ORIGINS += [f"https://{PROXY}.evil.example", ""]
PROXIED = [f"https://{PROXY}", f"https://{PROXY}:8443"]
PLACES = ["/../server.py", "/%2e%2e/server.py", "//etc/passwd", "/secret", "*", "/a%00b"]


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        *((*request, {"Host": host}, 421) for host in FOREIGN for request in REQUESTS),
        *(("GET", "/status", {"Host": host}, 200) for host in OWN),
        *(("POST", "/capture", {"Origin": origin}, 403) for origin in ORIGINS),
        # proxies pass on another host, or the same
        *(
            ("POST", "/capture", {"Host": host, "Origin": origin}, 200)
            for host in ("127.0.0.1:{port}", "gate.example", PROXY)
            for origin in PROXIED
        ),
        *((method, place, {}, 404) for method in ("GET", "HEAD") for place in PLACES),
        ("GET", "/capture", {}, 404),  # looking changes nothing
        ("POST", "/stream.mjpg", {}, 404),
        ("PUT", "/capture", {}, 501),
    ],
)
def test_who_may_ask_for_what(
    shown: Served, tmp_path: Path, method: str, path: str, headers: dict[str, str], status: int
) -> None:
    """Nothing is saved for another site's name or page, and there is nothing but the page."""
    (tmp_path / "secret").touch()
    asked = {name: value.format(port=shown.port) for name, value in headers.items()}
    assert shown.ask(path, method, **asked).status == status
    assert bool(names(tmp_path) - {"secret"}) == ((path, status) == ("/capture", 200))


def test_a_watcher_that_does_not_read_holds_up_nobody(served: Served) -> None:
    with socket.create_connection(("127.0.0.1", served.port)) as sleeper:
        sleeper.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sleeper.sendall(b"GET /stream.mjpg HTTP/1.0\r\nHost: localhost\r\n\r\n")
        assert sleeper.recv(12) == b"HTTP/1.0 200"
        awake = pictures(served.ask("/stream.mjpg"))
        for number in range(5):
            show(served.finder, number, noise)
            assert next(awake) == served.finder.after(number).jpeg
        assert served.facts("/status")[1]["frames"] == 5


def test_seats_are_few_and_come_free(shown: Served) -> None:
    watchers = [shown.ask("/stream.mjpg") for _ in range(8)]
    assert [watcher.status for watcher in watchers] == [200] * 8
    full = {"error": "8 people look through this camera already"}
    assert shown.facts("/stream.mjpg") == (503, full)
    watchers.pop().close()
    assert shown.ask("/stream.mjpg").status == 200  # though no picture is sent meanwhile


def test_closing_ends_the_streams_and_waits_for_the_shot_in_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on, save = threading.Event(), threading.Event(), ShotFolder.save

    def slowly(self: ShotFolder, *facts: Any) -> Path:
        begun.set()
        assert go_on.wait(60)
        return save(self, *facts)

    monkeypatch.setattr(ShotFolder, "save", slowly)
    finder = Viewfinder(lambda: 0, ShotFolder(tmp_path))
    show(finder, 0)
    with ThreadPoolExecutor() as pool:
        watcher, _ = pool.submit(finder.after, 1), pool.submit(finder.shoot)
        assert begun.wait(60)
        threading.Timer(0.2, go_on.set).start()
        finder.close()
        assert len(list(tmp_path.glob("*.dng"))) == 1
        assert watcher.result(60) is None
    with pytest.raises(InputError, match="has ended"):
        finder.shoot()


def test_an_address_that_is_taken_is_refused(served: Served) -> None:
    with pytest.raises(OutputError, match=f"{served.port}: nothing can be served there"):
        ViewfinderServer(("127.0.0.1", served.port), served.finder, print, ())


@pytest.mark.parametrize(
    ("width", "period", "scale"), [(1440, 6, 1), (1441, 6, 2), (4056, 4, 4), (9000, 4, 4)]
)
def test_a_picture_fits_the_page_if_the_pattern_allows(width: int, period: int, scale: int) -> None:
    assert fitting_scale(width, CfaPattern.bayer(period)) == scale


def test_what_fails_in_a_handler_is_told(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Viewfinder, "status", lambda _: 1 / 0)
    with pytest.raises((RemoteDisconnected, ConnectionError)):
        served.ask("/status")
    assert [type(fault) for fault in served.faults] == [ZeroDivisionError]
