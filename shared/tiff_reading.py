"""Reading single fields of an untrusted TIFF structure: TIFF 6.0, BigTIFF, Exif blocks, and camera RAWs that are built alike.

Only what is asked for is read. Whatever is damaged counts as missing: these fields are capture data, which no picture depends on.
"""

import struct
from collections.abc import Container
from dataclasses import dataclass, field
from typing import IO

_EXIF, _GPS = 34665, 34853
_BIG = 43
_MOST_FIELDS = 1024  # per directory, as in `tiff_check`
_LONGEST = 1 << 16  # bytes of a field
# Number format of a field type, and numbers per value; BYTE, ASCII, SBYTE and UNDEFINED stay bytes.
_BYTES = (1, 2, 6, 7)
_NUMBERS = {3: "H", 4: "I", 5: "I", 8: "h", 9: "i", 10: "i", 11: "f", 12: "d", 13: "I", 16: "Q", 17: "q", 18: "Q"}
_PAIRS = (5, 10)  # RATIONAL, SRATIONAL: numerator and denominator


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
    structure = _Structure(file, place)
    if not structure.first:
        return StoredDirectories()
    pointers: StoredFields = {}
    main = structure.directory(structure.first, wanted, pointers)
    below = [structure.directory(_offset(pointers.get(tag)), wanted, {}) for tag in (_EXIF, _GPS)]
    return StoredDirectories(main, *below)


class _Structure:
    """A TIFF structure: byte order, kind, and where its first directory is (0 = it is not one)."""

    def __init__(self, file: IO[bytes], place: int) -> None:
        self._file, self._place = file, place
        self._end = file.seek(0, 2) - place
        header = self._read(0, 16)
        self._order = {b"II": "<", b"MM": ">"}.get(header[:2], "")
        self.first = 0
        if len(header) < 8 or not self._order:
            return
        # Makers of cameras put numbers of their own where TIFF has 42.
        self._big = struct.unpack_from(f"{self._order}H", header, 2)[0] == _BIG
        if len(header) == 16 or not self._big:
            (self.first,) = struct.unpack_from(self._order + ("Q" if self._big else "I"), header, 8 if self._big else 4)

    def directory(self, offset: int, wanted: Container[int], pointers: StoredFields) -> StoredFields:
        """The wanted fields of the directory at `offset` (0 = there is none); fills `pointers` with those of other directories."""
        count_format, entry = (
            ("Q", struct.Struct(f"{self._order}HHQ8s")) if self._big else ("H", struct.Struct(f"{self._order}HHI4s"))
        )
        head = struct.calcsize(f"={count_format}")
        counted = self._read(offset, head) if offset else b""
        if len(counted) < head:
            return {}
        count = min(struct.unpack(self._order + count_format, counted)[0], _MOST_FIELDS)
        table = self._read(offset + head, count * entry.size)
        found: StoredFields = {}
        for tag, kind, length, value in entry.iter_unpack(table[: len(table) // entry.size * entry.size]):
            into = pointers if tag in (_EXIF, _GPS) else found
            if (tag in wanted or into is pointers) and tag not in into and (stored := self._field(kind, length, value)):
                into[tag] = stored
        return found

    def _field(self, kind: int, count: int, value: bytes) -> StoredField | None:
        letter = "s" if kind in _BYTES else _NUMBERS.get(kind)
        if letter is None or not count:
            return None
        size = count * struct.calcsize(f"={letter}") * (2 if kind in _PAIRS else 1)
        if size > len(value):
            (offset,) = struct.unpack(self._order + ("Q" if self._big else "I"), value)
            if (size > _LONGEST and letter != "s") or offset + size > self._end:
                return None
            value = self._read(offset, min(size, _LONGEST))
        if letter == "s":
            return StoredField(kind, value[:size])
        if len(value) < size:
            return None
        numbers = size // struct.calcsize(f"={letter}")
        return StoredField(kind, struct.unpack_from(f"{self._order}{numbers}{letter}", value))

    def _read(self, offset: int, size: int) -> bytes:
        if not 0 <= offset < max(self._end, 1):
            return b""
        self._file.seek(self._place + offset)
        return self._file.read(size)


def _offset(field: StoredField | None) -> int:
    value = field.numbers[0] if field and field.values and not isinstance(field.values, bytes) else 0
    return int(value) if 0 < value < 2**63 else 0
