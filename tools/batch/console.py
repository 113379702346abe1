"""Output of a command: results on stdout, everything else on stderr."""

import json as json_format
import logging
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..io.versions import install_command

if TYPE_CHECKING:
    from .progress import StageProgress

_PACKAGE = __name__.partition(".")[0]
LOG = logging.getLogger(_PACKAGE)
"""Notes of the library (WARNING), and the seconds of each stage (INFO)."""


class StandardOutputError(Exception):
    """Standard output cannot be written: its reader has left (`closed`), or the disk is full. The
    current file is not to blame.
    """

    def __init__(self, reason: OSError) -> None:
        super().__init__(f"standard output: cannot be written ({reason.strerror or reason})")
        self.closed = isinstance(reason, BrokenPipeError)


class WorkerFault(Exception):  # noqa: N818  (a PanchromaError is one that was foreseen)
    """An exception that nobody foresaw in a worker process: the message of `fault` there, and its
    traceback as a note.
    """


@dataclass(kw_only=True, eq=False)
class Console:
    """Lines for people, with `json` also one object per line for machines, and a progress bar where
    a terminal can show one.

    Parameters
    ----------
    json : bool, optional
        Standard output is for machines; what people read goes to standard error.
    quiet : bool, optional
        Standard error is for errors alone.
    spell : Callable[[str], str], optional
        Writes messages in the words of the command line.
    verbose : bool, optional
        An error is followed by the traceback of what caused it; there is a line for each stage.
    """

    json: bool = False
    quiet: bool = False
    verbose: bool = False
    spell: Callable[[str], str] = str

    def say(self, *lines: str) -> None:
        """Print the lines of a result, to stdout unless that is for machines.

        Raises StandardOutputError.
        """
        if not self.json:
            to_stdout(*(one_line(self.spell(line)) for line in lines))
        else:
            self.note(*lines)

    def note(self, *texts: str) -> None:
        """Print remarks to stderr."""
        if not self.quiet:
            for text in texts:
                to_stderr(self.spell(text))

    def notes(self, noted: Iterable[tuple[str, Iterable[str]]]) -> None:
        """Print remarks on sources to stderr, each once, with the first source that it is about.

        noted: (source, its remarks).
        """
        sources: dict[str, list[str]] = {}
        for source, remarks in noted:
            for remark in remarks:
                sources.setdefault(remark, []).append(source)
        for remark, (first, *more) in sources.items():
            self.note(f"{first}{f' and {len(more)} more' if more else ''}: {remark}")

    def error(self, *texts: str, cause: BaseException | None = None) -> None:
        """Print a line to stderr for each thing that failed.

        cause: what was raised.
        """
        for text in texts:
            to_stderr(f"panchroma: {self.spell(text)}")
        for line in traceback_of(cause).splitlines() if cause and self.verbose else ():
            to_stderr(line)

    def record(self, **facts: Any) -> None:
        """Print one object for machines to stdout; without `json`, nothing.

        Raises StandardOutputError.
        """
        if self.json:
            for name, value in facts.items():
                if isinstance(value, str):
                    facts[name] = self.spell(value)
            # the only control character that JSON leaves as it is
            to_stdout(json_format.dumps(facts).replace("\x7f", "\\u007f"))

    def progress(self, title: str) -> "StageProgress":
        """A listener for the stages of the work on one file; use it in a `with` block."""
        # Imported here, because it loads NumPy, which `panchroma --help` does not need.
        from .progress import BarProgress, LineProgress, StageProgress

        if self.quiet:
            return StageProgress(note=self.note)
        title = one_line(title)
        if sys.stderr.isatty() and not self.verbose:
            with suppress(ImportError):  # a camera has no package rich
                return BarProgress(title, self.note)
        return LineProgress(title, self.note)


def fault(error: BaseException) -> str:
    """The message for an exception that nobody foresaw, with the place where it was raised, or for
    a package that is missing.
    """
    if isinstance(error, WorkerFault):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        remedy = f"install Panchroma with all that belongs to it: {install_command()}"
        return f"the package {error.name} is not installed; {remedy}"
    frames = traceback.extract_tb(error.__traceback__)
    root = Path(__file__).parents[2]
    ours = [frame for frame in frames if Path(frame.filename).is_relative_to(root)]
    place = (ours or frames)[-1]
    where = f"{Path(place.filename).name}:{place.lineno} (-v shows the traceback)"
    return f"a fault of Panchroma, please report it: {type(error).__name__} in {where}: {error}"


def traceback_of(error: BaseException) -> str:
    """The traceback of an exception, in a worker process the one there; of a PanchromaError that of
    its cause, "" without one.
    """
    from ...shared.errors import PanchromaError  # not at the top: it imports NumPy

    if notes := getattr(error, "__notes__", None):
        return "\n".join(notes)
    cause: BaseException | None = error
    while isinstance(cause, PanchromaError):
        cause = cause.__cause__ or cause.__context__
    return "".join(traceback.format_exception(cause)) if cause else ""


@contextmanager
def shown_by(note: Callable[[str], None], level: int) -> Iterator[None]:
    """Give what Panchroma logs at this level, and its warnings, to `note` in a `with` block; the
    warnings of others are shown as before.
    """

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            note(record.getMessage())

    usual, before, handler = warnings.showwarning, LOG.level, Handler()

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if category.__module__.partition(".")[0] == _PACKAGE:
            note(str(message))
        else:
            usual(message, category, *place)

    with warnings.catch_warnings():
        warnings.showwarning = show  # type: ignore[assignment]  # the rest is the place, which ours do not need
        LOG.addHandler(handler)
        LOG.setLevel(level)
        try:
            yield
        finally:
            LOG.removeHandler(handler)
            LOG.setLevel(before)


def to_stdout(*lines: str) -> None:
    """Print lines, all at once.

    Raises StandardOutputError.
    """
    try:
        for line in lines:
            print(line)
        sys.stdout.flush()
    except OSError as error:
        raise StandardOutputError(error) from error


def to_stderr(text: str) -> None:
    """Print a line for people, if anybody is left who could read it."""
    with suppress(OSError):
        print(one_line(text), file=sys.stderr, flush=True)


def one_line(text: str) -> str:
    r"""`text` as one line that only shows: names and values from files may hold what a terminal
    obeys.

    Line breaks and tabs become a blank. Other control characters, those that reorder or hide text,
    unusual blanks and bytes of names that are no text are spelled out (\x1b, \u202e, \xa0, \udcff).
    """
    line = re.sub(r"[\t-\r\x85\u2028\u2029]+", " ", text)
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in line)
