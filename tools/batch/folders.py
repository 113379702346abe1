"""Input files of a command: files that are named, and the fitting files in and below folders."""

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import partial
from itertools import islice
from pathlib import Path
from unicodedata import normalize

from ...shared.writing import sweep
from .console import Console
from .jobs import FAILED, Job, fail, identity

# Endings of the names of shots.
DNGS = (".dng",)
_NAMED = 3  # files that a remark names, before it counts the others
_COUNTED = 1000  # files that are counted in folders that are not searched: snapshots have millions
# Folders in which other programs keep thumbnails, previews, deleted files and old versions: of
# Synology and QNAP; of NetApp, Nextcloud, Windows, macOS and Linux; of Lightroom, Capture One,
# Picasa and Apple's Photos. In lower case.
_FOREIGN = (
    *("@eadir", "@tmp", "@recycle", "@recently-snapshot", "@syno*", "#recycle", "#snapshot"),
    *("~snapshot", "files_trashbin", "files_versions", "$recycle.bin", "recycler"),
    *("system volume information", "__macosx", "network trash folder", "lost+found"),
    *("*.lrdata", "*.lrcat-data", "captureone", "picasaoriginals", "*.photoslibrary"),
)
_OTHER = "other"
SetAside = Callable[[Sequence[str]], Mapping[str, str]]
"""Says which of the fitting files in one folder are not taken, and why, in words that follow their
names.
"""


@dataclass(frozen=True)
class Source:
    """One file to work on.

    below: its path below the folder in which it was found; None for a file that the user named,
    which has to fit.
    """

    name: str
    below: Path | None = None

    @property
    def from_folder(self) -> bool:
        """True for one found in a folder, where it may turn out to be something else."""
        return self.below is not None


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
        A remark for each folder in which something does not fit, and one on `others`.
    others : list[str]
        Folders that are hidden or of other programs; they are not searched.
    """

    sources: list[Source] = field(default_factory=list)
    failures: list[tuple[str, str]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)

    def report(self, console: Console) -> int:
        """Tell the user what was left out and what failed; returns the exit code."""
        console.note(*self.left_out)
        for folder, reason in self.failures:
            fail(Job(folder), reason, console)
        return FAILED if self.failures else 0

    def walk(self, top: str, endings: Collection[str], output: object, set_aside: SetAside) -> None:
        """Add what is in and below a folder.

        output: `identity` of a folder that is not searched. The others: see `search`.
        """
        errors: list[OSError] = []
        fitting: list[Source] = []
        files_left_out: dict[str, list[str]] = {}  # why -> files
        folders_left_out: Counter[str] = Counter()  # kind -> number
        below = partial(os.path.relpath, start=top)
        for place, folders, files in os.walk(top, onerror=errors.append):
            kinds = {name: _kind_left_out(place, name, output) for name in sorted(folders)}
            foreign = [name for name, kind in kinds.items() if kind == _OTHER]
            self.others.extend(_joined(place, name) for name in foreign)
            folders_left_out.update(kind for kind in kinds.values() if kind not in ("", _OTHER))
            folders[:] = [name for name, kind in kinds.items() if not kind]
            taken, aside = [], dict[str, str]()
            files.sort(key=lambda name: (os.path.islink(_joined(place, name)), name))  # noqa: PTH114
            for name in files:  # a link comes behind what it leads to, whose name the result gets
                fits, hidden = Path(name).suffix.lower() in endings, name.startswith(".")
                if fits and not hidden:
                    taken.append(_joined(place, name))
                elif fits or not hidden:  # hidden files of other kinds are the system's, and ours
                    aside[_joined(place, name)] = ""
            aside |= {path: f" {why}" for path, why in set_aside(taken).items()}
            fitting += [Source(path, Path(below(path))) for path in taken if path not in aside]
            for path, why in aside.items():
                files_left_out.setdefault(why, []).append(below(path))
        self.sources.extend(fitting)
        for error in errors:
            reason = f"cannot be read ({error.strerror or error})"
            self.failures.append((str(error.filename), reason))
        if not fitting and not errors:
            kind = " or ".join(endings) if len(endings) < 3 else "fitting"
            self.failures.append((top, f"no {kind} file is in this folder or below it"))
        remarks = [f"{_listed(names, 'files')}{why}" for why, names in files_left_out.items()]
        for kind, count in folders_left_out.items():
            remarks.append(f"{count} {kind} {'folder' if count == 1 else 'folders'}")
        if remarks:
            self.left_out.append(f"{top}: left out {'; '.join(remarks)}")


def search(
    names: Sequence[str],
    endings: Collection[str],
    *,
    output: Path | None = None,
    is_file: Callable[[str], bool] = lambda _: False,
    set_aside: SetAside = lambda _: {},
) -> Search:
    """Find the files to work on, each once (see `once`).

    Left out are hidden files, and below a named folder those folders that are hidden or in which
    other programs keep thumbnails or deleted files. Links to folders are not followed.

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
    result, results = Search(), identity(output) if output else None
    for name in names:
        if not name:
            empty = "is empty; check the command, such as a variable that is not set"
            result.failures.append(("a name", empty))
        elif is_file(name) or not os.path.isdir(name):  # noqa: PTH112  Path takes no impossible names: reading them says what is wrong
            result.sources.append(Source(name))
        else:
            result.walk(name, endings, results, set_aside)
    result.sources[:] = once(result.sources)
    walks = ((folder, files) for folder in result.others for _, _, files in os.walk(folder))
    inside = ((folder, Path(file).suffix.lower()) for folder, files in walks for file in files)
    folders = Counter(islice((folder for folder, end in inside if end in endings), _COUNTED))
    if total := folders.total():
        number = f"{total}{' or more' * (total == _COUNTED)} file{'s' * (total > 1)}"
        where = f"{_listed(list(folders), 'folders')}, hidden or of other programs"
        remark = f"left out {number} in {where}; name such a folder to take its files"
        result.left_out.append(remark)
    return result


def once(sources: Iterable[Source]) -> list[Source]:
    """The sources, each file where it comes first. It may be named twice, through a link or in
    another case, or be named and found in its folder. A hard link is another file, as a copy is.
    """
    first: dict[object, Source] = {}
    for source in sources:
        first.setdefault(file_key(source.name), source)
    return list(first.values())


def file_key(name: str) -> object:
    """Return what all names of one file have in common, or the name of what is no file. Disks may
    take names for the same that differ in case or in the form of an accent.
    """
    found = identity(name)
    return (found, normalize("NFC", os.path.realpath(name)).casefold()) if found else name


def _kind_left_out(place: str, name: str, output: object) -> str:
    """Return what kind of folder is not searched; "" for one that is."""
    path = _joined(place, name)
    if os.path.islink(path):  # noqa: PTH114
        return "linked"
    if output is not None and identity(path) == output:
        return "result"
    is_other = name.startswith(".") or any(fnmatchcase(name.lower(), other) for other in _FOREIGN)
    return _OTHER if is_other else ""


def _listed(names: Sequence[str], unit: str) -> str:
    """Return the first names, and the number of the others."""
    more = f" and {len(names) - _NAMED} more {unit}" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _joined(place: str, name: str) -> str:
    return os.path.join(place, name)  # noqa: PTH118  keeps the folder as the user wrote it: pathlib drops "./"


def plan(
    sources: Sequence[Source], names: Callable[[str], Sequence[str]], folder: Path, *, dry_run: bool
) -> list[Job]:
    """One job per source, with outputs in `folder`, below which subfolders of a searched folder are
    mirrored, under the names that `names(source.name)` returns.

    Subfolders that exist already are freed of what killed processes have left half written, but for
    a dry run.
    """
    jobs = []
    for source in sources:
        place = folder if source.below is None else folder / source.below.parent
        outputs = tuple(place / name for name in names(source.name))
        jobs.append(Job(source.name, outputs, source.from_folder))
    if not dry_run:
        for below in {output.parent for job in jobs for output in job.outputs} - {folder}:
            sweep(below)
    return jobs
