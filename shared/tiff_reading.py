"""The structure of an untrusted TIFF (TIFF 6.0, BigTIFF, Exif blocks, camera RAWs that are built alike), and single fields of it.

Only what is asked for is read. Whatever is damaged counts as missing: these fields are capture data, which no picture depends on.
"""

import struct
from collections.abc import Container
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO, NamedTuple

MOST_FIELDS = 1024
"""Fields of a directory that are looked at; the largest in use have a hundred."""
BYTES = (1, 2, 6, 7)
"""Field types whose values are bytes: BYTE, ASCII, SBYTE, UNDEFINED."""
_BIG = 43
_EXIF, _GPS = 34665, 34853
_LONGEST = 1 << 16  # bytes of a field
# Number format of a field type, and numbers per value; BYTE, ASCII, SBYTE and UNDEFINED stay bytes.
_NUMBERS = {3: "H", 4: "I", 5: "I", 8: "h", 9: "i", 10: "i", 11: "f", 12: "d", 13: "I", 16: "Q", 17: "q", 18: "Q"}
_PAIRS = (5, 10)  # RATIONAL, SRATIONAL: numerator and denominator


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
        return struct.unpack(self._number, value)[0]

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


@dataclass(frozen=True)
class StoredField:
    """A field as it is in a file.

    kind: field type of TIFF.
    values: bytes for BYTE, ASCII, SBYTE and UNDEFINED (of long ones the first 64 KiB), otherwise numbers; rational ones in pairs,
        numerator and denominator in turn.
    """

    kind: int
    values: bytes | tuple[float, ...]

    @property
    def numbers(self) -> tuple[float, ...]:
        """Its values; those of rational numbers without value (denominator 0) are NaN."""
        if self.kind not in _PAIRS:
            return tuple(self.values)
        pairs = zip(self.values[::2], self.values[1::2], strict=True)
        return tuple(over / under if under else float("nan") for over, under in pairs)


StoredFields = dict[int, StoredField]


@dataclass(frozen=True)
class StoredDirectories:
    """The fields of the first directory of a file, of its Exif and of its GPS directory, by tag."""

    main: StoredFields = field(default_factory=dict)
    exif: StoredFields = field(default_factory=dict)
    gps: StoredFields = field(default_factory=dict)


def read_directories(file: IO[bytes], wanted: Container[int], place: int = 0) -> StoredDirectories:
    """The wanted fields of a TIFF structure; nothing for anything else.

    file: seekable; its position changes.
    wanted: tags that are read, in any directory.
    place: where in the file the structure begins; its offsets count from there.
    """
    structure = Structure(file, place)
    main, pointers = _directory(structure, structure.first, wanted)
    below = [_directory(structure, _offset(pointers.get(tag)), wanted)[0] for tag in (_EXIF, _GPS)]
    return StoredDirectories(main, *below)


def _directory(structure: Structure, offset: int, wanted: Container[int]) -> tuple[StoredFields, StoredFields]:
    """The wanted fields of the directory at `offset` (0 = there is none), and those that point to other directories."""
    found: StoredFields = {}
    pointers: StoredFields = {}
    with suppress(EOFError):
        for entry in structure.directory(offset)[1] if offset else ():
            into = pointers if entry.tag in (_EXIF, _GPS) else found
            if (entry.tag in wanted or into is pointers) and entry.tag not in into and (stored := _field(structure, entry)):
                into[entry.tag] = stored
    return found, pointers


def _field(structure: Structure, entry: Entry) -> StoredField | None:
    kind, value = entry.kind, entry.value
    letter = "s" if kind in BYTES else _NUMBERS.get(kind)
    if letter is None or not entry.length:
        return None
    size = entry.length * struct.calcsize(f"={letter}") * (2 if kind in _PAIRS else 1)
    if size > len(value):
        offset = structure.offset_in(value)
        if (size > _LONGEST and letter != "s") or offset + size > structure.end:
            return None
        value = structure.read(offset, min(size, _LONGEST))
    if letter == "s":
        return StoredField(kind, value[:size])
    if len(value) < size:
        return None
    return StoredField(kind, struct.unpack_from(f"{structure.order}{size // struct.calcsize(f'={letter}')}{letter}", value))


def _offset(field: StoredField | None) -> int:
    value = field.numbers[0] if field and field.values and not isinstance(field.values, bytes) else 0
    return int(value) if 0 < value < 2**63 else 0
