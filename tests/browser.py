"""A headless Chromium under remote control: as much of the DevTools protocol, spoken over a pipe,
as the tests of pages need.
"""

import base64
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

_NAMES = "chromium", "chromium-browser", "google-chrome"
_CHROMIUM = next(filter(None, map(shutil.which, _NAMES)), None)
_OPTIONS = (
    "--headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage --disable-extensions "
    "--disable-background-networking --hide-scrollbars --no-first-run --remote-debugging-pipe"
)
_PATIENCE = 60.0  # seconds


class Browser:
    """One page. The test that opens it is skipped where Chromium is not installed.

    errors: the page's exceptions, console errors and failed requests so far.
    requests: the URLs that the page has requested so far, without data URLs.
    """

    def __init__(
        self, profile: Path, width: int = 1200, height: int = 900, *, dark: bool = False
    ) -> None:
        """A window narrower than 700 pixels is a phone's: with touch instead of a mouse."""
        if _CHROMIUM is None:
            pytest.skip("pages in a browser: Chromium is not installed: apt-get install chromium")
        commands, self._commands = os.pipe()
        self._answers, answers = os.pipe()
        # Chromium reads commands from descriptor 3 and writes answers to 4: a shell puts the pipes
        # there.
        shell = ["bash", "-c", f'exec "$@" 3<&{commands} 4>&{answers}', "bash"]
        self._process = subprocess.Popen(
            [*shell, _CHROMIUM, *_OPTIONS.split(), f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(commands, answers),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(commands)
        os.close(answers)
        self._pending = b""
        self._count = 0
        self._session: dict[str, str] = {}
        self.errors: list[str] = []
        self.requests: list[str] = []
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        phone = width < 700
        size = {"width": width, "height": height, "deviceScaleFactor": 1}
        self.call("Emulation.setDeviceMetricsOverride", mobile=phone, **size)
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._commands)  # Chromium ends when nobody commands it
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._answers)

    def open(self, url: str) -> None:
        """Begin to load a page."""
        answer = self.call("Page.navigate", url=url)
        assert "errorText" not in answer, answer

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page, awaited."""
        awaited = {"returnByValue": True, "awaitPromise": True}
        answer = self.call("Runtime.evaluate", expression=expression, **awaited)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression: str) -> Any:
        """The expression's value, once it is true."""
        end = time.monotonic() + _PATIENCE
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < end, (
                f"never true: {expression}; the page: {self.evaluate('document.body.innerText')}"
            )
            time.sleep(0.1)
        return value

    def screenshot(self, clip: dict[str, float]) -> bytes:
        """A part of the page, as PNG; clip: x, y, width, height and scale."""
        picture = self.call("Page.captureScreenshot", format="png", clip=clip)
        return base64.b64decode(picture["data"])

    def call(self, method: str, **parameters: Any) -> Any:
        """The result of one command; events that arrive before it are recorded."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters, **self._session}
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while (answer := self._message()).get("id") != self._count:
            self._record(answer.get("method"), answer.get("params", {}))
        assert "error" not in answer, (method, answer)
        return answer["result"]

    def _message(self) -> dict[str, Any]:
        while b"\0" not in self._pending:
            piece = os.read(self._answers, 1 << 16)
            assert piece, "Chromium has ended"
            self._pending += piece
        first, _, self._pending = self._pending.partition(b"\0")
        return json.loads(first)

    def _record(self, event: str | None, given: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            self.errors.append(str(given["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and given["type"] in ("error", "assert"):
            self.errors.append(str(given["args"]))
        elif event == "Log.entryAdded" and given["entry"]["level"] == "error":
            self.errors.append(str(given["entry"]))
        elif event == "Network.requestWillBeSent" and not given["request"]["url"].startswith(
            "data:"
        ):
            self.requests.append(given["request"]["url"])
