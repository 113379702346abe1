"""Walking the structure of an untrusted TIFF file: TIFF 6.0, BigTIFF, Exif blocks, and camera RAWs that are built alike."""

import struct
from typing import IO, NamedTuple

MOST_FIELDS = 1024
"""Fields of a directory that are looked at; the largest in use have a hundred."""
BYTES = (1, 2, 6, 7)
"""Field types whose values are bytes: BYTE, ASCII, SBYTE, UNDEFINED."""
_BIG = 43


class Entry(NamedTuple):
    """A field of a directory. length: number of values. value: bytes of the values if they fit in here, or else of their offset."""

    tag: int
    kind: int
    length: int
    value: bytes


class Structure:
    """A TIFF structure.

    file: seekable; its position changes.
    place: where in the file the structure begins; its offsets count from there.
    The attribute `first` is the offset of the first directory, 0 if this is no TIFF structure; `end` is the length.
    """

    def __init__(self, file: IO[bytes], place: int = 0) -> None:
        self._file, self._place = file, place
        self.end = file.seek(0, 2) - place
        header = self.read(0, 16)
        self.order = {b"II": "<", b"MM": ">"}.get(header[:2], "")
        # Makers of cameras put numbers of their own where TIFF has 42.
        big = len(header) == 16 and bool(self.order) and struct.unpack_from(f"{self.order}H", header, 2)[0] == _BIG
        self._count, self._number = (f"{self.order}{letter}" for letter in ("QQ" if big else "HI"))
        self._entry = f"{self.order}HHQ8s" if big else f"{self.order}HHI4s"
        known = self.order and len(header) >= 8
        self.first: int = struct.unpack_from(self._number, header, 8 if big else 4)[0] if known else 0

    def read(self, offset: int, size: int) -> bytes:
        """The bytes at an offset, as many as there are."""
        if not 0 <= offset < max(self.end, 1):
            return b""
        self._file.seek(self._place + offset)
        return self._file.read(size)

    def offset_in(self, value: bytes) -> int:
        """The offset that an entry's value holds."""
        offset: int = struct.unpack(self._number, value)[0]
        return offset

    def directory(self, offset: int) -> tuple[int, list[Entry], int]:
        """The directory at an offset: number of fields that it declares, the fields, and the offset of the next one, 0 = none.

        No more than MOST_FIELDS fields are read, and no more than the file has. Raises EOFError if it ends before the directory.
        """
        head, size, tail = (struct.calcsize(each) for each in (self._count, self._entry, self._number))
        counted = self.read(offset, head)
        if len(counted) < head:
            raise EOFError
        (count,) = struct.unpack(self._count, counted)
        table = self.read(offset + head, min(count, MOST_FIELDS) * size)
        after = self.read(offset + head + count * size, tail)
        whole = table[: len(table) // size * size]
        return (
            count,
            [*map(Entry._make, struct.iter_unpack(self._entry, whole))],
            self.offset_in(after) if len(after) == tail else 0,
        )
