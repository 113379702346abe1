"""Jobs, of a source and its results each: where results go, what must not be replaced, and what the
user is told of each.
"""

import os
from collections import Counter
from collections.abc import Callable, Container, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from ...shared import writing
from ...shared.errors import ForeignFileError, InputError, OutputError, PanchromaError
from .console import Console, fault
from .parallel import Function, Results, in_threads, one_by_one
from .progress import StageProgress
from .signals import raise_lost_signal

FAILED = 1


@dataclass(frozen=True)
class Job:
    """One source and the files to be made from it.

    Attributes
    ----------
    source : str
        Name of the file.
    outputs : tuple[Path, ...]
        The files, the first of them what the job is about.
    from_folder : bool
        It was found in a folder: if it turns out to be a file of another kind, it is left out, and
        nothing has failed.
    frames : tuple[str, ...]
        Names of all files that the outputs are made from, of which `source` is the first; () =
        `source` alone.
    """

    source: str
    outputs: tuple[Path, ...] = ()
    from_folder: bool = False
    frames: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the name of its source."""
        return self.source

    @property
    def files(self) -> tuple[str, ...]:
        """The files that the outputs are made from."""
        return self.frames or (self.source,)

    @property
    def output(self) -> Path:
        """The first output."""
        return self.outputs[0]

    def make_folders(self) -> None:
        """Create the subfolders for the outputs; one stays empty if the job fails then.

        Raises OutputError.
        """
        for folder in {output.parent for output in self.outputs}:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                why = f"cannot be created ({error.strerror or error}); use another output folder"
                raise OutputError(f"{folder}: {why}") from None


State = Literal["made", "planned", "current", "foreign", "failed", "nothing"]
_WORDS = {"planned": "to be made", "current": "up to date", "foreign": "left alone"}


@dataclass(frozen=True)
class Outcome:
    """Result of a job that did not fail.

    Attributes
    ----------
    facts : dict[str, Any]
        For machines.
    lines : tuple[str, ...]
        For people.
    errors : tuple[str, ...]
        A line for each file that failed, though the result could be made without it.
    state : State
        Made; planned (nothing is written, but would be); current (up to date already).
    """

    facts: dict[str, Any] = field(default_factory=dict)
    lines: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    state: State = "made"


def planned(job: Job, errors: tuple[str, ...] = ()) -> Outcome:
    """The outcome in a dry run of a job that could be done."""
    facts = {"output": str(job.output), "dry_run": True}
    return Outcome(facts, (f"{job.source} -> {job.output}",), errors, "planned")


Work = Function[Job, Outcome]
"""Does one job; its notes and stages go to the listener."""


_created: list[Path] = []  # output folders of this command


def output_folder(folder: str, *, dry_run: bool = False) -> Path:
    """The folder that `-o` names, created with its parents, and free of what killed processes have
    left half written.

    dry_run: change nothing; it may be one that cannot be written to. Raises OutputError when it is
    not a folder, cannot be created, or cannot be written to.
    """
    path = Path(folder)
    if not folder:
        raise OutputError("the name of the output folder is empty; give the folder a name")
    missing = [folder for folder in (path, *path.parents) if not os.path.lexists(folder)]
    if dry_run and (missing[-1].parent if missing else path).is_dir():
        return path
    _created.extend(reversed(missing))
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is not a folder; name the folder for the results") from None
    except OSError as error:
        raise OutputError(f"{folder}: {writing.reason(error, [path, *missing][-1])}") from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: no permission to write in this folder; choose another")
    writing.sweep(path)
    return path


def remove_unused_folders() -> None:
    """Remove the output folders that were created for this command and are still empty."""
    while _created:
        with suppress(OSError):  # not empty, or gone
            _created.pop().rmdir()


def run_jobs(
    jobs: Sequence[Job],
    work: Work,
    console: Console,
    *,
    overwrite: bool = False,
    show: Callable[[str], StageProgress] | None = None,
    threads: int = 1,
) -> int:
    """Do each job that would replace nothing that must stay. A job that fails costs one line, and
    the others go on.

    Returns the exit code, 0 or 1. overwrite: results that exist may be replaced. show: makes the
    listener of a source; None = one that shows only notes. threads: in which jobs are done at a
    time; with several there are only notes.
    """
    possible = possible_jobs(jobs, console, overwrite=overwrite)
    show = show or (lambda _: StageProgress(note=console.note))
    if threads > 1:
        results = in_threads(work, possible, threads, console.note)
    else:
        results = one_by_one(work, possible, lambda job: show(job.source))
    return exit_code(do_jobs(results, console)) or (FAILED if len(possible) < len(jobs) else 0)


def exit_code(states: Counter[State]) -> int:
    """The exit code of jobs that ended in these states."""
    return FAILED if states["failed"] or states["nothing"] else 0


def possible_jobs(jobs: Sequence[Job], console: Console, *, overwrite: bool) -> list[Job]:
    """Return the jobs that would replace nothing that must stay.

    Each other one is reported as failed. Of two jobs with the same output the first gets it.

    overwrite: results that exist may be replaced.
    """
    inputs = {identity(name) for job in jobs for name in job.files} - {None}
    possible, owners = [], dict[str, str]()
    for job in jobs:
        try:
            _refuse_loss(job, inputs, owners)
            if not overwrite:
                refuse_existing(job.outputs)
            possible.append(job)
        except PanchromaError as error:
            fail(job, str(error), console)
    return possible


def do_jobs(results: Results[Job, Outcome], console: Console) -> Counter[State]:
    """Report each result as it comes, by a line and a record.

    Each failed frame counts as failed too. It is an error if all files are of another kind, so that
    nothing was made.

    Returns how many ended in which state.
    """
    states: Counter[State] = Counter()
    folders = set[str]()
    for job, result in results:
        folders.add(os.path.dirname(job.source))  # noqa: PTH120  as the user wrote it
        states[_report(job, result, console)] += 1
        states["failed"] += len(result.errors) if isinstance(result, Outcome) else 0
    if states["foreign"] and states["foreign"] == states.total():
        states["nothing"] += 1
        found = f"nothing was done: all {states['foreign']} files found are of another kind"
        fail(Job(os.path.commonpath(folders)), found, console)
    return states


def counted(states: Counter[State]) -> str:
    """The states of jobs in words, for example "3 made, 1 failed"."""
    found = [state for state in get_args(State)[:-1] if states[state]]  # "nothing" has been said
    return ", ".join(f"{states[state]} {_WORDS.get(state, state)}" for state in found)


def _report(job: Job, result: Outcome | Exception, console: Console) -> State:
    """Say and record what came of a job."""
    if isinstance(result, ForeignFileError) and job.from_folder:
        console.note(_named(job, str(result)))
        console.record(source=job.source, ok=True, foreign=True)
        return "foreign"
    if isinstance(result, Exception):
        fail(job, reason(result), console, result)
        return "failed"
    console.error(*result.errors)
    console.say(*result.lines)
    failed = {"error": "; ".join(result.errors)} if result.errors else {}
    console.record(source=job.source, ok=not failed, **failed, **result.facts)
    return result.state


def reason(error: BaseException) -> str:
    """Why a source has failed. An exception that nobody foresaw is a fault of Panchroma, which the
    user is asked to report.

    Raises Terminated if the exception is what was left of a signal.
    """
    raise_lost_signal()
    if isinstance(error, MemoryError):
        return "not enough memory for a picture of this size"
    return str(error) if isinstance(error, PanchromaError) else fault(error)


def fail(job: Job, message: str, console: Console, cause: Exception | None = None) -> None:
    """Report a failed job: a record, and a line that begins with the name of its source, or of
    another of its files.
    """
    message = _named(job, message)
    console.error(message, cause=cause)
    console.record(source=job.source, ok=False, error=message)


def write_report(path: Path, make: Callable[[], bytes], console: Console, overwrite: bool) -> bool:
    """Make and write a text about results, which stay if that fails; True if it is there."""
    try:
        writing.write_durably(path, console.spell(make().decode()).encode(), overwrite=overwrite)
    except Exception as error:  # drawing it may raise anything
        fail(Job(str(path)), reason(error), console, error)
        return False
    return True


def _named(job: Job, message: str) -> str:
    """A message that begins with the name of a file of this job."""
    named = any(message.startswith(f"{name}:") for name in (job.source, *job.files, *job.outputs))
    return message if named else f"{job.source}: {message}"


def _refuse_loss(job: Job, inputs: Container[object], owners: dict[str, str]) -> None:
    """Raise InputError or OutputError if the outputs of a job would replace an input, a folder, or
    another result of the same run.

    inputs: `identity` of every input. owners: name of an output -> source, of all jobs before; the
    outputs of this one are added.
    """
    for output in job.outputs:
        name = str(output).casefold()  # on many disks names that differ only in case are one file
        if name in owners:
            same = f"the result would have the same name as that of {owners[name]}"
            raise InputError(f"{job.source}: {same}; use another output folder")
        owners[name] = job.source
        if identity(output) in inputs:
            raise OutputError(f"{output}: is an input; use another output folder")
        if file_status(output) and output.is_dir():
            raise OutputError(f"{output}: is a folder; remove it, or use another output folder")


_REPLACE = "use `overwrite=True` to replace it"


def refuse_existing(outputs: Iterable[Path], remedy: str = _REPLACE) -> None:
    """Raise OutputError, which states the remedy, when one of the outputs exists."""
    for output in outputs:
        if os.path.lexists(output):
            raise OutputError(f"{output}: exists already; {remedy}")


def identity(path: str | Path | int) -> tuple[int, int] | None:
    """Device and inode number, which are the same for all links to a file; None when there is no
    such file.

    path: its name, or the descriptor of an open file.
    """
    status = file_status(path)
    return (status.st_dev, status.st_ino) if status else None


def file_status(path: str | Path | int) -> os.stat_result | None:
    """`os.stat` of a file; None when there is no such file."""
    try:
        return os.stat(path)  # noqa: PTH116 (Path takes no impossible names)
    except (OSError, ValueError):
        return None
