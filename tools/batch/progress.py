"""Progress of long work on a terminal or in a log."""

import logging
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Self

from ...shared.progress import Progress

Note = Callable[[str], None]
"""Called with a remark for the user."""
REMARKS = 1000
"""Remarks that are remembered where each is shown once; there may be one on each of a million
shots.
"""

_LOG = logging.getLogger(__name__.partition(".")[0])
_BETWEEN_REMARKS = 60.0  # seconds, where each is a line of its own


class StageProgress(Progress):
    """A listener that shows nothing but notes; what each stage took goes to the log. Leaving its
    `with` block ends the display.

    note: what to do with notes, which stay when the display has ended.
    """

    def __init__(self, title: str = "", note: Note = lambda _: None) -> None:
        self._title, self.note = title, note
        self._stage = ""  # name of the current one
        self._since = time.monotonic()

    def _label(self) -> str:
        return f"{self._title}: {self._stage}" if self._stage else self._title

    def stage(self, name: str, steps: int) -> None:
        """Remember its name; log the seconds that the stage before took."""
        self._end()
        self._stage, self._since = name, time.monotonic()

    def remark(self, text: str) -> None:
        """Say in words how far the work is."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the display."""
        if kind is None:
            self._end()

    def _end(self) -> None:
        if self._stage:
            _LOG.info("%s: %.1f s", self._label(), time.monotonic() - self._since)


class LineProgress(StageProgress):
    """A plain line now and then that says how far long work is, for logs and pipes."""

    _remarked = 0.0

    def stage(self, name: str, steps: int) -> None:
        """Begin to wait for the first remark."""
        super().stage(name, steps)
        self._remarked = self._remarked or self._since

    def remark(self, text: str) -> None:
        """Print the remark, if the last one is a minute old."""
        if time.monotonic() - self._remarked >= _BETWEEN_REMARKS:
            self._remarked = time.monotonic()
            with suppress(OSError):  # nobody is left who could read it
                print(f"{self._label()}, {text}", file=sys.stderr, flush=True)


class BarProgress(StageProgress):
    """A bar per file that shows the current stage."""

    def __init__(self, title: str, note: Note) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Display

        super().__init__(title, note)
        columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn()
        # rich would print to stderr, above the bar, what goes to stdout: right only where both are
        # the same terminal
        is_one, people = sys.stdout.isatty(), Console(stderr=True)
        self._display = Display(*columns, console=people, transient=True, redirect_stdout=is_one)
        self._task = self._display.add_task(title, total=None)

    def __enter__(self) -> Self:
        self._display.start()
        return self

    def stage(self, name: str, steps: int) -> None:
        """Restart the bar under this name."""
        super().stage(name, steps)
        self._display.reset(self._task, total=steps, description=self._label())

    def remark(self, text: str) -> None:
        """Show the remark beside the bar."""
        self._display.update(self._task, description=f"{self._label()}, {text}")

    def advance(self, steps: int = 1) -> None:
        """Let the bar grow."""
        self._display.advance(self._task, steps)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        super().__exit__(kind)
        self._display.stop()
