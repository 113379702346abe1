"""The viewfinder's web server, for one camera and a few viewers."""

import ipaddress
import json
import os
import select
import socket
import sys
import threading
from collections.abc import Callable, Container, Iterable
from contextlib import suppress
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import urlsplit

from ...shared.errors import InputError, OutputError, PanchromaError
from .viewfinder import Viewfinder

_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; img-src 'self' data:; style-src 'self'; "
    "script-src 'self'; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    # Other sites must not show the picture, nor load our page in an invisible frame to catch clicks
    # (clickjacking).
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_BOUNDARY = "frame"
_VIEWERS = 8
# seconds after which the last picture is sent again: Chromium shows a picture when the next one
# comes, and proxies want to hear something
_STALL = 1.0


Report = Callable[[BaseException], None]
"""Called with each error that is not a client's; they end one answer, not the server."""


class ViewfinderServer(ThreadingTCPServer):
    """The server of a viewfinder. Not an HTTPServer: that looks up its own host name, and without a
    network it waits for an answer.

    Raises InputError if the host is not an IP address. Raises OutputError if the port cannot be
    used.

    Parameters
    ----------
    address : tuple[str, int]
        (host, port); port 0 takes any free port.
    finder : Viewfinder
        The viewfinder.
    report : Report
        See `Report`.
    hosts : Iterable[str]
        Names in lower case under which browsers may ask for the page, beside addresses and the
        machine's own names.
    """

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False

    def __init__(
        self, address: tuple[str, int], finder: Viewfinder, report: Report, hosts: Iterable[str]
    ) -> None:
        self.finder, self._report = finder, report
        name = socket.gethostname().lower()
        short = name.partition(".")[0]
        self.allowed = frozenset(hosts)
        # .local: the name in multicast DNS
        self.hosts = self.allowed | {"localhost", name, short, f"{short}.local"}
        self.seats = threading.BoundedSemaphore(_VIEWERS)
        try:
            if ipaddress.ip_address(address[0]).version == 6:
                self.address_family = socket.AF_INET6
            super().__init__(address, _Handler)
        except ValueError:
            expected = "the address of a network interface, such as 127.0.0.1 or 0.0.0.0"
            raise InputError(f"{address[0]!r} is not {expected}") from None
        except (OSError, OverflowError) as error:
            fault = f"nothing can be served there ({getattr(error, 'strerror', None) or error})"
            raise OutputError(f"{address[0]} port {address[1]}: {fault}") from None

    @property
    def url(self) -> str:
        """The address of the page."""
        host, port = map(str, self.server_address[:2])
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore disconnects and timeouts of clients; report everything else."""
        error = sys.exception()
        if error is not None and not isinstance(error, ConnectionError | TimeoutError):
            self._report(error)


class _Handler(SimpleHTTPRequestHandler):
    """Serves the files in the folder of the page, the stream of pictures, figures and shots."""

    server: ViewfinderServer
    timeout = 10.0  # seconds for a client to send its request, or to accept data
    server_version, sys_version = "panchroma", ""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments, directory=str(Path(__file__).with_name("page")))

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if path == "/stream.mjpg":
            self._stream()
        elif path == "/status":
            self._answer(self.server.finder.status())
        else:
            super().do_GET()

    def send_head(self) -> Any:
        try:
            return super().send_head()
        except ValueError:  # a name that no file can have
            return self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")

    def do_POST(self) -> None:
        origin = self.headers.get("Origin")
        # A proxy may speak TLS and pass another Host on: then the page's own name is one of those
        # that were allowed.
        is_ours = origin in (None, f"http://{self.headers['Host']}")
        if not (is_ours or _host_of(origin or "") in self.server.allowed):
            self._refuse(HTTPStatus.FORBIDDEN, "shots are taken from the camera's own page")
        elif self.path != "/capture":
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")
        else:
            try:
                shot = self.server.finder.shoot()
            except PanchromaError as error:
                is_full = isinstance(error, OutputError)
                status = HTTPStatus.INSUFFICIENT_STORAGE if is_full else HTTPStatus.CONFLICT
                # Clients need not know where on this machine the shots are.
                self._refuse(status, str(error).replace(f"{self.server.finder.folder}{os.sep}", ""))
            else:
                self._answer({"file": shot.path.name, "write_ms": 1e3 * shot.write})

    def _stream(self) -> None:
        # A new viewer waits for the seat of one who has left.
        if not self.server.seats.acquire(timeout=2 * _STALL):
            reason = f"{_VIEWERS} people look through this camera already"
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, reason)
            return
        try:
            # Whatever waits in the buffer makes a slow client's picture older.
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 17)
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
            self.end_headers()
            self.wfile.write(f"--{_BOUNDARY}\r\n".encode())
            number, finder = 0, self.server.finder
            while not (finder.closed or self._has_left()):
                view = finder.after(number, _STALL) or finder.after(0, 0)
                if view:
                    number = view.number
                    head = f"Content-Type: image/jpeg\r\nContent-Length: {len(view.jpeg)}\r\n\r\n"
                    # Send the boundary now, not before the next picture: browsers show a picture
                    # when they have read its end.
                    self.wfile.write(head.encode() + view.jpeg + f"\r\n--{_BOUNDARY}\r\n".encode())
        finally:
            self.server.seats.release()

    def _has_left(self) -> bool:
        """True if the client has closed the connection; whatever else it says is ignored."""
        readable, _, _ = select.select([self.connection], [], [], 0)
        return bool(readable) and not self.connection.recv(4096)

    def parse_request(self) -> bool:
        """Read the request. Returns whether it is one, and addressed to this camera; if not, it has
        been answered with an error.

        Another site can make its own name point to this address (DNS rebinding), and its page would
        then count as ours. It cannot do so with an IP address or with the machine's own name.
        """
        if not super().parse_request():
            return False
        if not (ours := _is_own(self.headers.get("Host", ""), self.server.hosts)):
            start = "start `panchroma view --host NAME` with this one"
            advice = f"ask for the camera by its address or its own name, or {start}"
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST, advice)
        return ours

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self._answer({"error": reason}, status)

    def _answer(self, facts: dict[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        body = json.dumps(facts).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def end_headers(self) -> None:
        """Add what every answer has."""
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002  the base's name
        """Log nothing: there are thousands of status requests."""


def _is_own(host: str, allowed: Container[str]) -> bool:
    """True if a Host header has an IP address or one of the allowed names."""
    name = _host_of(f"//{host}")
    with suppress(ValueError):
        return bool(ipaddress.ip_address(name))
    return name in allowed


def _host_of(url: str) -> str:
    """The name, or address, of the host in a URL; "" if there is none."""
    with suppress(ValueError):
        return urlsplit(url).hostname or ""
    return ""
