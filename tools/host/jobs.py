"""Many files, one after the other: where each result goes, and what happens when one fails."""

import argparse
import os
import shlex
from collections.abc import Callable, Container, Iterable, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shared.errors import InputError, OutputError, PanchromaError
from shared.reading import MAX_PIXELS
from shared.writing import sweep

from .console import Console, StandardOutputError, fault

FAILED = 1


@dataclass(frozen=True)
class Job:
    """One source and the files to be made of it."""

    source: str
    outputs: tuple[Path, ...]


def add_limit(parser: argparse.ArgumentParser) -> None:
    """--max-pixels, of commands that read files from anywhere."""
    parser.add_argument(
        "--max-pixels", type=int, default=MAX_PIXELS, metavar="N", help="of a file that is read; what claims more is refused"
    )


def output_folder(folder: str) -> Path:
    """The folder of `-o`, without what killed processes have left there half written.

    Raises OutputError when it is none, or nothing can be written there.
    """
    path = Path(folder)
    if not folder:
        raise OutputError("-o is empty: name the folder for the results")
    if identity(path) is None:
        raise OutputError(f"{folder}: the output folder does not exist; create it first: mkdir -p {shlex.quote(folder)}")
    if not path.is_dir():
        raise OutputError(f"{folder}: is not a folder; -o names the folder for the results")
    if not os.access(path, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: no permission to write in this folder; choose another")
    sweep(path)
    return path


def plan(sources: Sequence[str], names: Callable[[str], Sequence[str]], folder: Path) -> list[Job]:
    """A job per source, outputs in `folder` under the names that `names(source)` gives."""
    return [Job(source, tuple(folder / name for name in names(source))) for source in sources]


def run_jobs(jobs: Iterable[Job], work: Callable[[Job], dict[str, Any]], console: Console, *, overwrite: bool = False) -> int:
    """Do each job that may be done; one line for each that fails, the rest go on. Returns the exit code, 0 or 1.

    work: does one job, returns facts about it for machines.
    """
    failed = False
    planned: dict[str, str] = {}
    jobs = list(jobs)
    inputs = {identity(job.source) for job in jobs} - {None}
    for job in jobs:
        try:
            refuse_loss(job.source, job.outputs, inputs, planned)
            if not overwrite:
                refuse_existing(job.outputs)
            facts = work(job)
        except PanchromaError as error:
            failed = True
            fail(job.source, job.outputs, str(error), console)
        except MemoryError:
            failed = True
            fail(job.source, job.outputs, "not enough memory for a picture of this size", console)
        except StandardOutputError:
            raise
        except Exception as error:
            # So that one odd file does not cost a night's batch; `fault` says that it is ours to mend.
            failed = True
            fail(job.source, job.outputs, fault(error), console)
        else:
            console.record(source=job.source, ok=True, **facts)
    return FAILED if failed else 0


def fail(source: str, outputs: Iterable[Path], message: str, console: Console) -> None:
    """Say that a source came to nothing: a line that names it or an output, unless it does so already, and a record."""
    if not any(message.startswith(f"{name}:") for name in (source, *outputs)):
        message = f"{source}: {message}"
    console.error(message)
    console.record(source=source, ok=False, error=message)


def refuse_loss(
    source: str, outputs: Iterable[Path], inputs: Container[tuple[int, int] | None], planned: MutableMapping[str, str]
) -> None:
    """Raise unless these outputs replace no input and no result of the same run.

    inputs: `identity` of each; planned: output -> source of what has been planned so far, which this adds to.
    """
    for output in outputs:
        # Names that differ in case alone are one file on many disks.
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
    """Raise OutputError when one of them exists."""
    for output in outputs:
        if identity(output) is not None:
            raise OutputError(f"{output}: exists already; use --overwrite to replace it")


def identity(path: str | Path) -> tuple[int, int] | None:
    """What tells a file from all others, whatever links lead to it; None when there is none of this name."""
    try:
        status = Path(path).stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino
