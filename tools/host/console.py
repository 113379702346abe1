"""What a command shows to people and machines: results on stdout, everything else on stderr."""

import json as json_format
import re
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

_BETWEEN_REMARKS = 10.0  # seconds, where each remark is a line of its own
_PACKAGES = ("shared", "device", "offline", "tools")


class StandardOutputError(Exception):
    """Standard output cannot be written: its reader has left (`closed`), or the disk is full. The current file is not to blame."""

    def __init__(self, reason: OSError) -> None:
        super().__init__(f"standard output: cannot be written ({reason.strerror or reason})")
        self.closed = isinstance(reason, BrokenPipeError)


class WorkerFault(Exception):  # noqa: N818  (a PanchromaError is one that was foreseen)
    """An exception that nobody foresaw in a worker process. Its text is the message of `fault` there."""


class Console:
    """Lines for people, with `json` also one object per line for machines, and a progress bar where a terminal can show one."""

    def __init__(self, *, json: bool = False) -> None:
        self._json = json
        self._display: RichProgress | None = None

    def say(self, text: str) -> None:
        """Print a result, to stdout unless that is for machines. Raises StandardOutputError."""
        if self._json:
            _to_stderr(text)
        else:
            _to_stdout(text)

    def note(self, text: str) -> None:
        """Print a remark to stderr."""
        _to_stderr(one_line(text))

    def error(self, text: str) -> None:
        """Print one line that says what failed to stderr; line breaks in `text` are removed."""
        _to_stderr(f"panchroma: {one_line(text)}")

    def record(self, **facts: Any) -> None:
        """Print one object for machines to stdout; without `json`, nothing. Raises StandardOutputError."""
        if self._json:
            _to_stdout(json_format.dumps(facts))

    def progress(self, title: str) -> "StageProgress":
        """A listener for the stages of the work on one file; use it in a `with` block."""
        title = one_line(title)
        if not sys.stderr.isatty():
            return LineProgress(title)
        if self._display is None:
            self._display = _rich_progress()
        return BarProgress(title, self._display)

    def close(self) -> None:
        """Restore the terminal and flush stdout. Raises StandardOutputError."""
        if self._display is not None:
            self._display.stop()
            self._display = None
        _to_stdout()


def fault(error: BaseException) -> str:
    """The message for an exception that nobody foresaw, with the place where it was raised, or for a package that is missing."""
    if isinstance(error, ModuleNotFoundError) and error.name and error.name.partition(".")[0] not in _PACKAGES:
        return f"the package {error.name} is not installed; install Panchroma with all that belongs to it: pip install -e '.[all]'"
    if isinstance(error, WorkerFault):
        return str(error)
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
    with suppress(OSError):  # nobody is left who could read it
        print(text, file=sys.stderr, flush=True)


def one_line(text: str) -> str:
    """`text` without line breaks and other control characters, which file names may contain."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f]+", " ", text)


class StageProgress:
    """A `shared.progress.Progress` that shows nothing. Leaving its `with` block ends the display."""

    _title = _name = ""  # of the work, and of its current stage

    def _label(self) -> str:
        return f"{self._title}: {self._name}" if self._name else self._title

    def begin(self, steps: int) -> None:
        """Begin work of `steps` steps that has no stages."""

    def stage(self, name: str, steps: int) -> None:
        """Begin a stage of `steps` steps."""

    def advance(self, steps: int = 1) -> None:
        """Count `steps` more steps as done."""

    def remark(self, text: str) -> None:
        """Say in words how far it is."""

    def __enter__(self) -> "StageProgress":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """End the display."""


class LineProgress(StageProgress):
    """One plain line per finished stage with the seconds it took, for logs and pipes."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._since = 0.0
        self._remarked = time.monotonic()

    def remark(self, text: str) -> None:
        """Print the remark, if the last one is some seconds old."""
        if time.monotonic() - self._remarked >= _BETWEEN_REMARKS:
            self._remarked = time.monotonic()
            _to_stderr(f"{self._label()}, {text}")

    def stage(self, name: str, steps: int) -> None:
        """Print the time that the stage before took."""
        self._end()
        self._name, self._since = name, time.monotonic()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self._end()

    def _end(self) -> None:
        if self._name:
            _to_stderr(f"{self._title}: {self._name} {time.monotonic() - self._since:.1f} s")


class BarProgress(StageProgress):
    """A bar per file that shows the current stage."""

    def __init__(self, title: str, display: "RichProgress") -> None:
        self._title = title
        self._display = display
        self._task: TaskID = display.add_task(title, total=None)

    def __enter__(self) -> "BarProgress":
        self._display.start()
        return self

    def stage(self, name: str, steps: int) -> None:
        """Restart the bar under this name."""
        self._name = name
        self._display.reset(self._task, total=steps, description=f"{self._title}: {name}")

    def begin(self, steps: int) -> None:
        """Start the bar under the title alone."""
        self._display.reset(self._task, total=steps, description=self._title)

    def remark(self, text: str) -> None:
        """Show the remark beside the bar."""
        self._display.update(self._task, description=f"{self._label()}, {text}")

    def advance(self, steps: int = 1) -> None:
        """Let the bar grow."""
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
    # rich would print to stderr, above the bar, what goes to stdout: right only where both are the same terminal.
    return rich.progress.Progress(
        *columns, console=rich.console.Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty()
    )
