"""How a terminal or a log shows the progress of long work."""

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ...shared.progress import Progress
from .console import to_stderr

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

Note = Callable[[str], None]
"""Called with a remark for the user."""
REMARKS = 1000
"""Remarks that are remembered where each is shown once; there may be one on each of a million shots."""

_BETWEEN_REMARKS = 10.0  # seconds, where each is a line of its own


class StageProgress(Progress):
    """A listener that shows nothing, but knows the current stage. Leaving its `with` block ends the display.

    title: of the work.
    note: what to do with notes, which stay when the display has ended.
    """

    shows = False  # whether anybody sees its remarks

    def __init__(self, title: str = "", note: Note = lambda _: None) -> None:
        self._title, self._name, self._part = title, "", ""  # of the work, of its current stage, and of the part that this is in
        self.note = note

    @property
    def current(self) -> str:
        """Name of the current stage, and of the part that it is in; "" before the first one."""
        return f"{self._name} ({self._part})" if self._part else self._name

    def _label(self) -> str:
        return f"{self._title}: {self.current}" if self._name else self._title

    def stage(self, name: str, steps: int) -> None:
        """Remember its name."""
        self._name, self._part = name, ""

    def part(self, name: str) -> None:
        """Remember its name."""
        self._part = name

    def remark(self, text: str) -> None:
        """Say in words how far the work is."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """End the display."""


class LineProgress(StageProgress):
    """One plain line per finished stage with the seconds it took, for logs and pipes."""

    shows = True

    def __init__(self, title: str = "", note: Note = lambda _: None) -> None:
        super().__init__(title, note)
        self._since = 0.0
        self._remarked = time.monotonic()

    def remark(self, text: str) -> None:
        """Print the remark, if the last one is some seconds old."""
        if time.monotonic() - self._remarked >= _BETWEEN_REMARKS:
            self._remarked = time.monotonic()
            to_stderr(f"{self._label()}, {text}")

    def stage(self, name: str, steps: int) -> None:
        """Print the time that the stage before took."""
        self._end()
        super().stage(name, steps)
        self._since = time.monotonic()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self._end()

    def _end(self) -> None:
        if self._name:
            to_stderr(f"{self._title}: {self._name} {time.monotonic() - self._since:.1f} s")


class BarProgress(StageProgress):
    """A bar per file that shows the current stage."""

    shows = True

    def __init__(self, title: str, note: Note, display: "RichProgress") -> None:
        super().__init__(title, note)
        self._display = display
        self._task: TaskID = display.add_task(title, total=None)

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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._display.remove_task(self._task)
        self._display.stop()


def rich_display() -> "RichProgress":
    """The display of all bars of a terminal, not yet started."""
    import rich.progress
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn()
    # rich would print to stderr, above the bar, what goes to stdout: right only where both are the same terminal.
    one_terminal = sys.stdout.isatty()
    return rich.progress.Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=one_terminal)
