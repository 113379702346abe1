"""What is to be rendered, and where each picture goes: shots as they are given, folders with everything below them."""

import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from shared.errors import InputError

_SUFFIX = ".dng"


@dataclass(frozen=True)
class Shot:
    """One picture to make. found: in a folder, among files that may be anything; given by name it has to be a shot."""

    source: str
    output: Path
    found: bool = False


def expand(given: Sequence[str], folder: Path, suffix: str) -> tuple[list[Shot], list[tuple[str, str]]]:
    """The shots, in the order given, of a folder in the order of their names; and (source, what is wrong) of what yields none.

    A shot's picture goes to `folder`, that of a shot in a folder below it as the shot lay: subfolders are mirrored. Hidden files
    and folders are left out, links to folders not followed, and `folder` itself, where it lies in one that is given, not entered.
    """
    shots: list[Shot] = []
    failures = []
    for source in given:
        if not _is_folder(source):
            shots.append(Shot(source, folder / (Path(source).stem + suffix)))
            continue
        errors: list[OSError] = []
        below = list(_below(Path(source), folder, errors))
        failures += [(str(error.filename), f"cannot be read ({error.strerror or error})") for error in errors]
        if not below and not errors:
            failures.append((source, f"no {_SUFFIX} file is in this folder or below it"))
        shots += [Shot(str(path), folder / path.relative_to(source).with_suffix(suffix), found=True) for path in below]
    return shots, failures


def _is_folder(source: str) -> bool:
    try:
        return Path(source).is_dir()
    except (OSError, ValueError):  # an impossible name: whoever reads it says so
        return False


def _below(top: Path, output: Path, errors: list[OSError]) -> Iterator[Path]:
    for place, folders, files in os.walk(top, onerror=errors.append):
        folders[:] = sorted(name for name in folders if not (name.startswith(".") or _same(Path(place, name), output)))
        for name in sorted(files):
            if name.lower().endswith(_SUFFIX) and not name.startswith("."):
                yield Path(place, name)


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return False


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count`, 1 to count. Which part a picture is in depends on its path below the output folder alone.

    So machines agree without talking, and files that are added meanwhile move no other.
    """

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Of "3/8". Raises InputError."""
        index, _, count = text.partition("/")
        if index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
            return cls(int(index), int(count))
        raise InputError(f"--shard is {text!r}, expected a part and their number, such as 3/8; parts are counted from 1")

    def has(self, output: str) -> bool:
        """Whether the picture with this path belongs to the part."""
        digest = hashlib.sha256(os.fsencode(output)).digest()
        return int.from_bytes(digest[:8], "big") % self.count == self.index - 1
