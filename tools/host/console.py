"""What a person or a machine sees of a running command: results on stdout, everything else on stderr."""

import json as json_format
import re
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from shared.progress import Progress

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

_BETWEEN_REMARKS = 10.0  # seconds, where each is a line of its own
_PACKAGES = ("shared", "device", "offline", "tools")


class StandardOutputError(Exception):
    """Standard output takes no more: its reader has left (`closed`), or the disk is full. No fault of the file at work."""

    def __init__(self, reason: OSError) -> None:
        super().__init__(f"standard output: cannot be written ({reason.strerror or reason})")
        self.closed = isinstance(reason, BrokenPipeError)


class Console:
    """Lines for people, one object per line for machines (`json`); a progress display where a terminal can show one."""

    def __init__(self, *, json: bool = False) -> None:
        self._json = json
        self._display: RichProgress | None = None

    def say(self, text: str) -> None:
        """A result: to stdout, unless stdout is for machines. Raises StandardOutputError."""
        if self._json:
            _to_stderr(text)
        else:
            _to_stdout(text)

    def note(self, text: str) -> None:
        """Something one should know beside the result, to stderr."""
        _to_stderr(one_line(text))

    def error(self, text: str) -> None:
        """One line that says what failed, to stderr, whatever line breaks its parts have."""
        _to_stderr(f"panchroma: {one_line(text)}")

    def record(self, **facts: Any) -> None:
        """One object for machines, to stdout; nothing unless asked for. Raises StandardOutputError."""
        if self._json:
            _to_stdout(json_format.dumps(facts))

    def progress(self, title: str) -> "StageProgress":
        """A listener for the stages of one file's work, to be used in a `with` block."""
        title = one_line(title)
        if not sys.stderr.isatty():
            return LineProgress(title)
        if self._display is None:
            self._display = _rich_progress()
        return BarProgress(title, self._display)

    def close(self) -> None:
        """Leave the terminal as it was, and nothing unwritten. Raises StandardOutputError."""
        if self._display is not None:
            self._display.stop()
            self._display = None
        _to_stdout()


def fault(error: BaseException) -> str:
    """What to say of an exception that nobody foresaw, with the place it came from; a missing library is what it is."""
    if isinstance(error, ModuleNotFoundError) and error.name and error.name.partition(".")[0] not in _PACKAGES:
        return f"the package {error.name} is not installed; install Panchroma with all that belongs to it: pip install -e '.[all]'"
    frames = traceback.extract_tb(error.__traceback__)
    root = Path(__file__).parents[2]
    ours = [frame for frame in frames if any(Path(frame.filename).is_relative_to(root / package) for package in _PACKAGES)]
    place = (ours or frames)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}"
    return f"a fault of Panchroma, please report it: {type(error).__name__} in {where}: {error}"


def _to_stdout(*lines: str) -> None:
    try:
        for line in lines:
            print(line)
        sys.stdout.flush()
    except OSError as error:
        raise StandardOutputError(error) from error


def _to_stderr(text: str) -> None:
    with suppress(OSError):  # nobody is left to tell
        print(text, file=sys.stderr, flush=True)


def one_line(text: str) -> str:
    """Without line breaks and other control characters: file names may have any."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f]+", " ", text)


class StageProgress(Progress):
    """A `shared.progress.Progress` for one file, ended by leaving the `with` block."""

    def begin(self, steps: int) -> None:
        """Work that has no stages begins."""

    def remark(self, text: str) -> None:
        """How far it is, in words: of work that lasts."""

    def __enter__(self) -> "StageProgress":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Nobody needs the display any more."""


class LineProgress(StageProgress):
    """One plain line per stage that has ended, with the seconds it took: for logs and pipes."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._name = ""
        self._since = 0.0
        self._remarked = time.monotonic()

    def remark(self, text: str) -> None:
        """A line, now and then."""
        if time.monotonic() - self._remarked >= _BETWEEN_REMARKS:
            self._remarked = time.monotonic()
            name = f"{self._title}: {self._name}" if self._name else self._title
            _to_stderr(f"{name}, {text}")

    def stage(self, name: str, steps: int) -> None:
        """The stage before it has ended: say so."""
        self._end()
        self._name, self._since = name, time.monotonic()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self._end()

    def _end(self) -> None:
        if self._name:
            _to_stderr(f"{self._title}: {self._name} {time.monotonic() - self._since:.1f} s")


class BarProgress(StageProgress):
    """A bar per file that shows the stage at work."""

    def __init__(self, title: str, display: "RichProgress") -> None:
        self._title = title
        self._display = display
        self._name = ""
        self._task: TaskID = display.add_task(title, total=None)

    def __enter__(self) -> "BarProgress":
        self._display.start()
        return self

    def stage(self, name: str, steps: int) -> None:
        """The bar begins again, under this name."""
        self._name = name
        self._display.reset(self._task, total=steps, description=f"{self._title}: {name}")

    def begin(self, steps: int) -> None:
        """The bar begins, under the title alone."""
        self._display.reset(self._task, total=steps, description=self._title)

    def remark(self, text: str) -> None:
        """It stands beside the bar."""
        name = f"{self._title}: {self._name}" if self._name else self._title
        self._display.update(self._task, description=f"{name}, {text}")

    def advance(self, steps: int = 1) -> None:
        """The bar grows."""
        self._display.advance(self._task, steps)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._display.remove_task(self._task)
        self._display.stop()


def _rich_progress() -> "RichProgress":
    import rich.console
    import rich.progress

    columns = (
        rich.progress.TextColumn("{task.description}", markup=False),
        rich.progress.BarColumn(),
        rich.progress.TimeElapsedColumn(),
    )
    # rich prints above the bar what goes to stdout meanwhile, to stderr: only where both are one terminal is that right.
    return rich.progress.Progress(
        *columns, console=rich.console.Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty()
    )
