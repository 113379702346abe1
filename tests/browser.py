"""A headless Chromium under remote control: the DevTools protocol over a pipe, as much of it as a page's test needs."""

import base64
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_PATIENCE = 60.0  # seconds


class Browser:
    """One page."""

    def __init__(self, profile: Path, width: int = 1280, height: int = 860, *, dark: bool = False) -> None:
        assert CHROMIUM
        commands, self._commands = os.pipe()
        self._answers, answers = os.pipe()
        # DevTools reads commands from descriptor 3 and writes to 4. A shell puts them there, wherever they are.
        place = f'exec "$@" 3<&{commands} 4>&{answers}'
        options = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--no-first-run",
            "--remote-debugging-pipe",
        ]
        self._process = subprocess.Popen(
            ["bash", "-c", place, "bash", CHROMIUM, *options, f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(commands, answers),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(commands)
        os.close(answers)
        self._pending = b""
        self._count = 0
        self._session = ""
        pages = [target for target in self.call("Target.getTargets")["targetInfos"] if target["type"] == "page"]
        self._session = self.call("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)["sessionId"]
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 700)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def call(self, method: str, **parameters: Any) -> Any:
        """The result of one command."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._pending:
                piece = os.read(self._answers, 1 << 16)
                assert piece, "the browser has gone"
                self._pending += piece
            answer, _, self._pending = self._pending.partition(b"\0")
            document = json.loads(answer)
            if document.get("id") == self._count:
                assert "error" not in document, document
                return document["result"]

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)

    def evaluate(self, expression: str) -> Any:
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)["result"].get("value")

    def until(self, expression: str) -> Any:
        """The expression's value, once it is true."""
        end = time.monotonic() + _PATIENCE
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < end, (
                f"{expression} never came true; the page says: {self.evaluate('document.body.innerText')}"
            )
            time.sleep(0.1)
        return value

    def screenshot(self, clip: dict[str, float]) -> bytes:
        """A part of the page, as PNG; clip: x, y, width, height and scale."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png", clip=clip)["data"])

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        os.close(self._commands)  # Chromium leaves when nobody commands it
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._answers)
