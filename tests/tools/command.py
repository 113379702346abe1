"""The commands as a user runs them: in this process, or in one of their own."""

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panchroma.tools.batch.journal import NAME as JOURNAL
from panchroma.tools.cli import main
from tests.data import ROOT

SCRIPT = "from panchroma.tools.cli import main; main()"
PROGRAM = (sys.executable, "-c", SCRIPT)


@dataclass(frozen=True)
class Outcome:
    """Exit code, standard output and standard error of a command."""

    code: int
    out: str
    err: str

    @property
    def errors(self) -> list[str]:
        """The lines that say what failed."""
        return [line for line in self.err.splitlines() if line.startswith("panchroma: ")]

    @property
    def records(self) -> list[dict[str, Any]]:
        """The objects that --json prints, one a line; fails if standard output holds anything
        else.
        """
        return [json.loads(line) for line in self.out.splitlines()]


def words(*arguments: str | Path) -> list[str]:
    """The words of a command line. Of these arguments the first, and every text that begins with an
    option, may be several words, with a blank between them.
    """
    line: list[str] = []
    for number, argument in enumerate(arguments):
        is_several = isinstance(argument, str) and (number == 0 or argument.startswith("-"))
        line += str(argument).split(" ") if is_several else [str(argument)]
    return line


def run(*arguments: str | Path, code: int | None = None) -> Outcome:
    """Run a command in this process. arguments: see `words`; code: the exit code to insist on;
    None: any.
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(words(*arguments))
        except SystemExit as leaving:
            left = leaving.code
    assert isinstance(left, int)
    assert left == code or code is None, err.getvalue()
    return Outcome(left, out.getvalue(), err.getvalue())


def repeated(option: str, values: Iterable[str | Path]) -> list[str | Path]:
    """An option before each of its values."""
    return [word for value in values for word in (option, value)]


def start(
    *arguments: str | Path, before: tuple[str, ...] = (), script: str = SCRIPT, **options: Any
) -> "subprocess.Popen[str]":
    """A command, started in a process of its own; standard output and error are pipes of text.

    arguments: see `words`.
    before: a program that starts the one whose command line follows.
    script: what the process runs, with these arguments.
    options: of subprocess.Popen.
    """
    usual = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "cwd": ROOT, "text": True}
    line = [*before, sys.executable, "-c", script, *words(*arguments)]
    return subprocess.Popen(line, **{**usual, **options})


def ended(
    process: "subprocess.Popen[str]", number: int | None = None, *, code: int | None = None
) -> Outcome:
    """The end of a command that was started. number: of a signal that ends it; code: as in
    `run`.
    """
    if number is not None:
        process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert process.returncode == code or code is None, err
    return Outcome(process.returncode, out, err)


def spawn(*arguments: str | Path, code: int | None = None, **options: Any) -> Outcome:
    """A command in a process of its own, run to its end. code: as in `run`; options: of `start`."""
    return ended(start(*arguments, **options), code=code)


def names(folder: Path) -> set[str]:
    """Names of the files in a folder, hidden ones too."""
    return {path.name for path in folder.iterdir()}


def shots(folder: Path) -> list[Path]:
    """The shots in a folder, in the order of their names."""
    return sorted(folder.glob("*.dng"))


def contents(folder: Path) -> dict[str, bytes]:
    """Path below the folder -> bytes, of every file, hidden ones too."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def results(folder: Path) -> set[str]:
    """Names of the files in a folder, without the journal that `render` keeps."""
    return names(folder) - {JOURNAL}


def assert_refused(outcome: Outcome, *words: str, name: str) -> None:
    """Fail unless there is one error line that names the file once and says `words`, and no
    traceback.
    """
    assert outcome.code == 1, outcome.err
    (line,) = outcome.errors
    assert line.startswith(f"panchroma: {name}: "), line
    assert line.count(Path(name).name) == 1, line
    assert [word for word in words if word not in line] == [], line
    assert "Traceback" not in outcome.err
    assert "fault" not in outcome.err
