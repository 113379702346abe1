"""Which shots to render, and where each picture goes: files that are named, and all DNGs in and below folders."""

import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from shared.errors import InputError
from tools.host.jobs import identity

_SUFFIX = ".dng"


@dataclass(frozen=True)
class Shot:
    """One picture to make.

    source: name of the file.
    output: where its picture goes.
    found: found in a folder, where it may be any DNG; otherwise the user named it, and it has to be a shot.
    """

    source: str
    output: Path
    found: bool = False


def expand(given: Sequence[str], folder: Path, suffix: str) -> tuple[list[Shot], list[tuple[str, str]]]:
    """The shots of files and folders, and (source, what is wrong) for each source that has none.

    given: files and folders; shots come in this order, those of a folder ordered by name.
    folder: the output folder. A named shot's picture goes there; subfolders of a given folder are mirrored.
    suffix: of a picture's file name.

    Hidden files and folders are left out. Links to folders are not followed, and `folder` itself is not searched.
    """
    shots: list[Shot] = []
    failures = []
    for source in given:
        if not os.path.isdir(source):  # noqa: PTH112  Path takes no impossible names: reading them says what is wrong
            shots.append(Shot(source, folder / (Path(source).stem + suffix)))
            continue
        errors: list[OSError] = []
        below = list(_below(Path(source), folder, errors))
        failures += [(str(error.filename), f"cannot be read ({error.strerror or error})") for error in errors]
        if not below and not errors:
            failures.append((source, f"no {_SUFFIX} file is in this folder or below it"))
        shots += [Shot(str(path), folder / path.relative_to(source).with_suffix(suffix), found=True) for path in below]
    return shots, failures


def _below(top: Path, output: Path, errors: list[OSError]) -> Iterator[Path]:
    left_out = {identity(output)} - {None}
    for place, folders, files in os.walk(top, onerror=errors.append):
        folders[:] = sorted(name for name in folders if not (name.startswith(".") or identity(Path(place, name)) in left_out))
        for name in sorted(files):
            if name.lower().endswith(_SUFFIX) and not name.startswith("."):
                yield Path(place, name)


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count`, 1 to count. A picture's path below the output folder alone decides which part it belongs to.

    So machines agree without communication, and a new file does not change the part of any other.
    """

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """The part that a text such as "3/8" names. Raises InputError."""
        index, _, count = text.partition("/")
        if index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
            return cls(int(index), int(count))
        raise InputError(f"--shard is {text!r}, expected a part and their number, such as 3/8; parts are counted from 1")

    def has(self, output: str) -> bool:
        """Whether the picture with this path belongs to the part."""
        digest = hashlib.sha256(os.fsencode(output)).digest()
        return int.from_bytes(digest[:8], "big") % self.count == self.index - 1
