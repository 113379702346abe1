"""Jobs: one source each, done one after the other. Where the results go, what must not be replaced, what a failure means."""

import os
import shlex
import stat
from collections.abc import Callable, Container, Iterable, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shared.errors import ForeignFileError, InputError, OutputError, PanchromaError
from shared.writing import dangling_link, sweep

from .console import Console, StandardOutputError, fault
from .signals import raise_lost_signal

FAILED = 1


@dataclass(frozen=True)
class Job:
    """One source and the files to be made from it.

    found: it was found in a folder: if it turns out to be a file of another kind, it is left out, and nothing has failed.
    """

    source: str
    outputs: tuple[Path, ...] = ()
    found: bool = False

    def make_folders(self) -> None:
        """Create the subfolders for the outputs. Call it when all else has gone well. Raises OutputError."""
        for folder in {output.parent for output in self.outputs}:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(f"{folder}: the folder cannot be created ({error.strerror or error}); choose another") from None


_created: list[Path] = []  # output folders of this command


def output_folder(folder: str, *, dry_run: bool = False) -> Path:
    """The folder that `-o` names, created if its parent exists, and free of what killed processes have left half written.

    dry_run: do not create it.

    Raises OutputError when it is not a folder, cannot be created, or cannot be written to.
    """
    path = Path(folder)
    if not folder:
        raise OutputError("the name of the output folder is empty; give `output` or `report` a folder")
    if identity(path) is None:
        if os.path.islink(path):  # noqa: PTH114 (Path takes no impossible names)
            raise OutputError(f"{folder}: {dangling_link(path)}, or name another folder")
        parent = file_status(path.parent)
        if parent is None:
            advice = f"create it first: mkdir -p {shlex.quote(str(path.parent))}"
            raise OutputError(f"{folder}: the folder {path.parent} does not exist; {advice}")
        if not stat.S_ISDIR(parent.st_mode):
            raise OutputError(f"{folder}: {path.parent} is not a folder; choose another place for the results")
        if dry_run:
            return path
        try:
            path.mkdir(exist_ok=True)  # several commands may begin at the same time
        except OSError as error:
            raise OutputError(f"{folder}: the folder cannot be created ({error.strerror or error}); choose another") from None
        _created.append(path)
    if not path.is_dir():
        raise OutputError(f"{folder}: is not a folder; name the folder for the results")
    if not os.access(path, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: no permission to write in this folder; choose another")
    sweep(path)
    return path


def remove_unused_folders() -> None:
    """Remove the output folders that were created for this command and are still empty."""
    while _created:
        with suppress(OSError):  # not empty, or gone
            _created.pop().rmdir()


def run_jobs(jobs: Iterable[Job], work: Callable[[Job], dict[str, Any]], console: Console, *, overwrite: bool = False) -> int:
    """Do each job that would replace nothing that must stay. A job that fails costs one line, and the others go on.

    work: does one job and returns facts about it for machines.
    overwrite: results that exist may be replaced.

    Returns the exit code, 0 or 1.
    """
    failed = False
    planned: dict[str, str] = {}
    jobs = list(jobs)
    inputs = {identity(job.source) for job in jobs} - {None}
    for job in jobs:
        raise_lost_signal()
        try:
            refuse_loss(job.source, job.outputs, inputs, planned)
            if not overwrite:
                refuse_existing(job.outputs)
            facts = work(job)
        except StandardOutputError:
            raise
        except ForeignFileError as error:
            if not job.found:
                failed = True
                fail(job.source, job.outputs, str(error), console)
                continue
            message = str(error)
            console.note(message if message.startswith(f"{job.source}:") else f"{job.source}: {message}")
            console.record(source=job.source, ok=True, foreign=True)
        except Exception as error:  # one odd file must not end a night's batch
            failed = True
            fail(job.source, job.outputs, reason(error), console)
        else:
            console.record(source=job.source, ok=True, **facts)
    return FAILED if failed else 0


def reason(error: BaseException) -> str:
    """Why a source has failed. An exception that nobody foresaw is a fault of Panchroma, which the user is asked to report.

    Raises Terminated if the exception is what was left of a signal.
    """
    raise_lost_signal()
    if isinstance(error, MemoryError):
        return "not enough memory for a picture of this size"
    return str(error) if isinstance(error, PanchromaError) else fault(error)


def fail(source: str, others: Iterable[str | Path], message: str, console: Console) -> None:
    """Report a failed source: a record, and a line that begins with the name of the source, or of another file if `message` does.

    others: files that the message may begin with: results, and further sources.
    """
    if not any(message.startswith(f"{name}:") for name in (source, *others)):
        message = f"{source}: {message}"
    console.error(message)
    console.record(source=source, ok=False, error=message)


def refuse_loss(
    source: str, outputs: Iterable[Path], inputs: Container[tuple[int, int] | None], planned: MutableMapping[str, str]
) -> None:
    """Raise InputError or OutputError if these outputs would replace an input, a folder, or another result of the same run.

    inputs: `identity` of every input.
    planned: output -> source of everything planned so far; these outputs are added.
    """
    for output in outputs:
        # On many disks names that differ only in case are one file.
        name = os.path.normcase(output).casefold()
        if name in planned:
            if planned[name] == source:
                raise InputError(f"{source}: is given twice")
            raise InputError(f"{source}: the result would have the same name as that of {planned[name]}; use another output folder")
        planned[name] = source
        found = identity(output)
        if found is None:
            continue
        if found in inputs:
            raise OutputError(f"{output}: is an input; use another output folder")
        if output.is_dir():
            raise OutputError(f"{output}: is a folder; remove it, or use another output folder")


def refuse_existing(outputs: Iterable[Path]) -> None:
    """Raise OutputError when one of the outputs exists."""
    for output in outputs:
        if identity(output) is not None:
            raise OutputError(f"{output}: exists already; use `overwrite=True` to replace it")
        if os.path.islink(output):  # noqa: PTH114
            raise OutputError(f"{output}: {dangling_link(output)}, or use `overwrite=True` to replace it")


def identity(path: str | Path | int) -> tuple[int, int] | None:
    """Device and inode number, which are the same for all links to a file; None when there is no such file.

    path: its name, or the descriptor of an open file.
    """
    status = file_status(path)
    return (status.st_dev, status.st_ino) if status else None


def file_status(path: str | Path | int) -> os.stat_result | None:
    """`os.stat` of a file; None when there is no such file."""
    with suppress(OSError, ValueError):
        return os.stat(path)  # noqa: PTH116 (Path takes no impossible names)
    return None
