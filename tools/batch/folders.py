"""What a command works on: files that are named, and the fitting files in and below folders. All commands search them alike."""

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...shared.writing import sweep
from .console import Console
from .jobs import Job, fail, identity

# Endings of the names of shots.
DNGS = (".dng",)
_NAMED = 3  # files that a remark names, before it counts the others
SetAside = Callable[[Sequence[str]], Mapping[str, str]]
"""Says which of the fitting files in one folder are not taken, and why, in words that follow their names."""


@dataclass(frozen=True)
class Source:
    """One file to work on.

    name: of the file.
    below: its path below the folder in which it was found; None for a file that the user named, which has to fit.
    """

    name: str
    below: Path | None = None

    @property
    def found(self) -> bool:
        """Found in a folder, where it may turn out to be something else."""
        return self.below is not None

    def output(self, folder: Path, name: str) -> Path:
        """Where a result called `name` goes: into `folder`, below which subfolders of a searched folder are mirrored."""
        return folder / name if self.below is None else folder / self.below.parent / name


@dataclass(frozen=True)
class Search:
    """What was found.

    sources: in the order in which they were given, those of a folder ordered by name.
    failures: (folder, what is wrong) of each folder that cannot be read, or has no fitting file.
    left_out: a remark for each folder in which something does not fit.
    """

    sources: list[Source] = field(default_factory=list)
    failures: list[tuple[str, str]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def report(self, console: Console) -> bool:
        """Tell the user what was left out and what failed. Returns whether nothing has failed."""
        console.note(*self.left_out)
        for folder, what in self.failures:
            fail(Job(folder), what, console)
        return not self.failures


def search(
    given: Sequence[str],
    endings: Collection[str],
    *,
    output: Path | None = None,
    is_file: Callable[[str], bool] = lambda _: False,
    set_aside: SetAside = lambda _: {},
) -> Search:
    """Find the files to work on.

    given: files, which are taken as they are, and folders, in and below which all files with the right endings are taken.
    endings: of the names of fitting files, in lower case, with the dot.
    output: folder of results, which is not searched.
    is_file: says of a name that it is none of a folder, whatever the disk holds.
    set_aside: see `SetAside`; a file that the user names is taken.

    Hidden files and folders are left out, and links to folders are not followed.
    """
    found = Search()
    for source in given:
        if not source:
            found.failures.append(("a name", "is empty; check the command, such as a variable that is not set"))
        elif is_file(source) or not os.path.isdir(source):  # noqa: PTH112  Path takes no impossible names: reading them says what is wrong
            found.sources.append(Source(source))
        else:
            _search(source, endings, identity(output) if output else None, set_aside, found)
    return found


def _search(top: str, endings: Collection[str], output: tuple[int, int] | None, set_aside: SetAside, found: Search) -> None:
    errors: list[OSError] = []
    fitting: list[Source] = []
    others: dict[str, list[str]] = {"": []}  # why -> files
    counts = {"hidden": 0, "result": 0, "linked": 0}
    for place, folders, files in os.walk(top, onerror=errors.append):
        searched = []
        for name in sorted(folders):
            path = os.path.join(place, name)  # noqa: PTH118  keeps the folder as the user wrote it: pathlib drops "./"
            reason = "hidden" if name.startswith(".") else "linked" if os.path.islink(path) else ""  # noqa: PTH114
            if output is not None and identity(path) == output:
                reason = "result"
            if reason:
                counts[reason] += 1
            else:
                searched.append(name)
        folders[:] = searched
        taken = []
        for name in sorted(files):
            path = os.path.join(place, name)  # noqa: PTH118
            fits = Path(name).suffix.lower() in endings
            if fits and not name.startswith("."):
                taken.append(path)
            elif fits or not name.startswith("."):  # hidden files of other kinds are the system's, and ours
                others[""].append(os.path.relpath(path, top))
        aside = set_aside(taken)
        fitting += [Source(path, Path(os.path.relpath(path, top))) for path in taken if path not in aside]
        for path, why in aside.items():
            others.setdefault(f" {why}", []).append(os.path.relpath(path, top))
    found.sources.extend(fitting)
    found.failures.extend((str(error.filename), f"cannot be read ({error.strerror or error})") for error in errors)
    if not fitting and not errors:
        found.failures.append(
            (top, f"no {' or '.join(endings) if len(endings) < 3 else 'fitting'} file is in this folder or below it")
        )
    parts = [
        ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more files" if len(names) > _NAMED else "") + why
        for why, names in others.items()
        if names
    ]
    parts += [f"{count} {kind} {'folder' if count == 1 else 'folders'}" for kind, count in counts.items() if count]
    if parts:
        found.left_out.append(f"{top}: left out {'; '.join(parts)}")


def plan(sources: Sequence[Source], names: Callable[[str], Sequence[str]], folder: Path, *, dry_run: bool = False) -> list[Job]:
    """One job per source, with outputs in `folder` (see `Source.output`) under the names that `names(source.name)` returns.

    Subfolders that exist already are freed of what killed processes have left half written, but for a dry run.
    """
    jobs = [Job(each.name, tuple(each.output(folder, name) for name in names(each.name)), each.found) for each in sources]
    for below in {output.parent for job in jobs for output in job.outputs} - {folder} if not dry_run else ():
        sweep(below)
    return jobs
