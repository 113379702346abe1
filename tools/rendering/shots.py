"""Which shots to render, where each picture goes, and which of them belong to a part of the work."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from shared.errors import InputError
from tools.host.folders import Source


@dataclass(frozen=True)
class Shot:
    """One picture to make.

    source: name of the file.
    output: where its picture goes.
    found: found in a folder, where it may be any DNG; otherwise the user named it, and it has to be a shot.
    frames: names of the files of a burst, of which `source` is the first; () = the picture is made from `source` alone.
    page: where the report on a burst goes; None = there is none.
    """

    source: str
    output: Path
    found: bool = False
    frames: tuple[str, ...] = ()
    page: Path | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """The files that the picture is made from."""
        return self.frames or (self.source,)

    @property
    def outputs(self) -> tuple[Path, ...]:
        """The files that are made: the picture first."""
        return (self.output,) if self.page is None else (self.output, self.page)


def shots_of(sources: Sequence[Source], folder: Path, suffix: str) -> list[Shot]:
    """The shots of the files that were named or found in folders.

    folder: the output folder, see `Source.output`.
    suffix: of a picture's file name.
    """
    return [Shot(each.name, each.output(folder, Path(each.name).stem + suffix), each.found) for each in sources]


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
