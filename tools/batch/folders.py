"""Input files of a command: files that are named, and the fitting files in and below folders."""

import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from ...shared.writing import sweep
from .console import Console
from .jobs import Job, fail, identity

# Endings of the names of shots.
DNGS = (".dng",)
_NAMED = 3  # files that a remark names, before it counts the others
SetAside = Callable[[Sequence[str]], Mapping[str, str]]
"""Says which of the fitting files in one folder are not taken, and why, in words that follow their
names.
"""


@dataclass(frozen=True)
class Source:
    """One file to work on.

    Attributes
    ----------
    name : str
        Of the file.
    below : Path | None
        Its path below the folder in which it was found; None for a file that the user named, which
        has to fit.
    """

    name: str
    below: Path | None = None

    @property
    def from_folder(self) -> bool:
        """True for one found in a folder, where it may turn out to be something else."""
        return self.below is not None

    def output(self, folder: Path, name: str) -> Path:
        """Path of a result called `name` in `folder`, below which subfolders of a searched folder
        are mirrored.
        """
        return folder / name if self.below is None else folder / self.below.parent / name


@dataclass(frozen=True)
class Search:
    """Files that were found.

    Attributes
    ----------
    sources : list[Source]
        In the order in which they were given, those of a folder ordered by name.
    failures : list[tuple[str, str]]
        (folder, what is wrong) of each folder that cannot be read, or has no fitting file.
    left_out : list[str]
        A remark for each folder in which something does not fit.
    """

    sources: list[Source] = field(default_factory=list)
    failures: list[tuple[str, str]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def report(self, console: Console) -> bool:
        """Tell the user what was left out and what failed.

        Returns
        -------
        bool
            Whether nothing has failed.
        """
        console.note(*self.left_out)
        for folder, reason in self.failures:
            fail(Job(folder), reason, console)
        return not self.failures


def search(
    names: Sequence[str],
    endings: Collection[str],
    *,
    output: Path | None = None,
    is_file: Callable[[str], bool] = lambda _: False,
    set_aside: SetAside = lambda _: {},
) -> Search:
    """Find the files to work on.

    Hidden files and folders are left out, and links to folders are not followed.

    Parameters
    ----------
    names : Sequence[str]
        Files, which are taken as they are, and folders, in and below which all files with the right
        endings are taken.
    endings : Collection[str]
        Of the names of fitting files, in lower case, with the dot.
    output : Path | None, optional
        Folder of results, which is not searched.
    is_file : Callable[[str], bool], optional
        Says of a name that it is none of a folder, whatever the disk holds.
    set_aside : SetAside, optional
        See `SetAside`; a file that the user names is taken.
    """
    result = Search()
    for name in names:
        if not name:
            empty = "is empty; check the command, such as a variable that is not set"
            result.failures.append(("a name", empty))
        elif is_file(name) or not os.path.isdir(name):  # noqa: PTH112  Path takes no impossible names: reading them says what is wrong
            result.sources.append(Source(name))
        else:
            _search(name, endings, identity(output) if output else None, set_aside, result)
    return result


def _search(
    top: str,
    endings: Collection[str],
    output: tuple[int, int] | None,
    set_aside: SetAside,
    result: Search,
) -> None:
    errors: list[OSError] = []
    fitting: list[Source] = []
    files_left_out: dict[str, list[str]] = {}  # why -> files
    folders_left_out: Counter[str] = Counter()  # kind -> number
    below = partial(os.path.relpath, start=top)
    for place, folders, files in os.walk(top, onerror=errors.append):
        kinds = {name: _kind_left_out(place, name, output) for name in folders}
        folders_left_out.update(filter(None, kinds.values()))
        folders[:] = sorted(name for name in folders if not kinds[name])
        taken, aside = [], dict[str, str]()
        for name in sorted(files):
            fits, hidden = Path(name).suffix.lower() in endings, name.startswith(".")
            if fits and not hidden:
                taken.append(_joined(place, name))
            elif fits or not hidden:  # hidden files of other kinds are the system's, and ours
                aside[_joined(place, name)] = ""
        aside |= {path: f" {why}" for path, why in set_aside(taken).items()}
        fitting += [Source(path, Path(below(path))) for path in taken if path not in aside]
        for path, why in aside.items():
            files_left_out.setdefault(why, []).append(below(path))
    result.sources.extend(fitting)
    result.failures.extend(
        (str(error.filename), f"cannot be read ({error.strerror or error})") for error in errors
    )
    if not fitting and not errors:
        kind = " or ".join(endings) if len(endings) < 3 else "fitting"
        result.failures.append((top, f"no {kind} file is in this folder or below it"))
    remarks = []
    for why, names in files_left_out.items():
        more = f" and {len(names) - _NAMED} more files" if len(names) > _NAMED else ""
        remarks.append(f"{', '.join(names[:_NAMED])}{more}{why}")
    for kind, count in folders_left_out.items():
        remarks.append(f"{count} {kind} {'folder' if count == 1 else 'folders'}")
    if remarks:
        result.left_out.append(f"{top}: left out {'; '.join(remarks)}")


def _kind_left_out(place: str, name: str, output: tuple[int, int] | None) -> str:
    """Return what kind of folder is not searched; "" for one that is."""
    path = _joined(place, name)
    if name.startswith("."):
        return "hidden"
    if os.path.islink(path):  # noqa: PTH114
        return "linked"
    return "result" if output is not None and identity(path) == output else ""


def _joined(place: str, name: str) -> str:
    return os.path.join(place, name)  # noqa: PTH118  keeps the folder as the user wrote it: pathlib drops "./"


def plan(
    sources: Sequence[Source],
    names: Callable[[str], Sequence[str]],
    folder: Path,
    *,
    dry_run: bool = False,
) -> list[Job]:
    """One job per source, with outputs in `folder` (see `Source.output`) under the names that
    `names(source.name)` returns.

    Subfolders that exist already are freed of what killed processes have left half written, but for
    a dry run.
    """
    jobs = []
    for source in sources:
        outputs = tuple(source.output(folder, name) for name in names(source.name))
        jobs.append(Job(source.name, outputs, source.from_folder))
    if not dry_run:
        for below in {output.parent for job in jobs for output in job.outputs} - {folder}:
            sweep(below)
    return jobs
