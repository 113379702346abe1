"""The structure of an untrusted TIFF (TIFF 6.0, BigTIFF, Exif blocks, camera RAWs that are built
alike): single fields of it, and a check of its directories before a library parses them.

`read_directories` reads only what is asked for, and counts as missing what is damaged: these fields
are capture data, which no picture depends on.

`check_directories` and `check_page` refuse a file before a library parses it. tifffile and Pillow
create a Python object for every number that a field declares, and follow every directory that
another names. A malicious file of some megabytes can thus fill gigabytes of memory or keep them
busy for hours.
"""

import struct
from collections.abc import Container, Set
from contextlib import suppress
from io import SEEK_END
from typing import IO, Any, NamedTuple

from .errors import InputError
from .limits import LIMITS, check_count
from .tiff import RATIOS, number_format, value_bytes

BYTES = (1, 2, 6, 7)
"""Field types whose values are bytes: BYTE, ASCII, SBYTE, UNDEFINED."""
EXIF, GPS, INTEROPERABILITY = 34665, 34853, 40965
_LONGEST = 1 << 16  # bytes of a field


class Entry(NamedTuple):
    """A field of a directory.

    Attributes
    ----------
    length : int
        Number of values.
    value : bytes
        Bytes of the values if they fit in here, or else of their offset.
    """

    tag: int
    kind: int
    length: int
    value: bytes

    @property
    def size(self) -> int:
        """Bytes of all values; 0 if the type is unknown."""
        return self.length * value_bytes(self.kind)


class Structure:
    """A TIFF structure.

    The attribute `first` is the offset of the first directory, 0 if this is no TIFF structure;
    `end` is the length.

    Parameters
    ----------
    file : IO[bytes]
        Seekable; its position changes.
    place : int, optional
        Where in the file the structure begins; its offsets count from there.
    """

    def __init__(self, file: IO[bytes], place: int = 0) -> None:
        self._file, self._place = file, place
        self.end = file.seek(0, SEEK_END) - place
        header = self.read(0, 16)
        self._order = {b"II": "<", b"MM": ">"}.get(header[:2], "")
        # TIFF has 42 here, and BigTIFF 43; makers of cameras put numbers of their own.
        big = len(header) == 16 and header[2:4] == struct.pack(f"{self._order or '<'}H", 43)
        layouts = ("Q", "HHQ8s", "Q") if big else ("H", "HHI4s", "I")
        structs = (struct.Struct(self._order + layout) for layout in layouts)
        self._count, self._entry, self._offset = structs
        known = self._order and len(header) >= 8
        self.first: int = self._offset.unpack_from(header, 8 if big else 4)[0] if known else 0

    def read(self, offset: int, size: int) -> bytes:
        """Return the bytes at an offset, as many as there are."""
        if not 0 <= offset < max(self.end, 1):
            return b""
        self._file.seek(self._place + offset)
        return self._file.read(size)

    def directory(self, offset: int) -> tuple[int, list[Entry], int]:
        """Read the directory at an offset: number of fields that it declares, the fields, and the
        offset of the next one, 0 = none.

        No more fields are read than `limits` allow, and no more than the file has.

        Raises
        ------
        EOFError
            If it ends before the directory.
        """
        counted, size = self.read(offset, self._count.size), self._entry.size
        if len(counted) < self._count.size:
            raise EOFError
        (count,), start = self._count.unpack(counted), offset + len(counted)
        table = self.read(start, min(count, LIMITS["fields in a directory"]) * size)
        entries = map(Entry._make, self._entry.iter_unpack(table[: len(table) // size * size]))
        after = self.read(start + count * size, self._offset.size)
        following = self._offset.unpack(after)[0] if len(after) == self._offset.size else 0
        return count, list(entries), following

    def values(self, entry: Entry, longest: int) -> bytes:
        """Return the bytes of an entry's values, at most `longest`; none unless all of them are in
        the file.
        """
        if entry.size <= len(entry.value):
            return entry.value[: entry.size]
        (offset,) = self._offset.unpack(entry.value)
        is_whole = offset + entry.size <= self.end
        return self.read(offset, min(entry.size, longest)) if is_whole else b""

    def numbers(self, kind: int, values: bytes) -> tuple[float, ...]:
        """Return the numbers in the bytes of values; rational ones without value (denominator 0)
        are NaN.
        """
        layout = struct.Struct(self._order + number_format(kind))
        numbers = tuple(number for (number,) in layout.iter_unpack(values))
        if kind not in RATIOS:
            return numbers
        ratios = zip(numbers[::2], numbers[1::2], strict=True)
        return tuple(over / under if under else float("nan") for over, under in ratios)


class StoredField(NamedTuple):
    """A field as it is in a file.

    Attributes
    ----------
    kind : int
        Field type of TIFF.
    data : bytes
        The values of BYTE, ASCII, SBYTE and UNDEFINED, of long ones the first 64 KiB.
    numbers : tuple[float, ...]
        The values of any other type.
    """

    kind: int
    data: bytes = b""
    numbers: tuple[float, ...] = ()


StoredFields = dict[int, StoredField]


class StoredDirectories(NamedTuple):
    """The fields of the first directory of a file, of its Exif, GPS and interoperability
    directories, by tag.
    """

    main: StoredFields
    exif: StoredFields
    gps: StoredFields
    interoperability: StoredFields


def read_directories(file: IO[bytes], wanted: Set[int], place: int = 0) -> StoredDirectories:
    """Read the wanted fields of a TIFF structure; nothing of anything else.

    Parameters
    ----------
    file : IO[bytes]
        Seekable; its position changes.
    wanted : Set[int]
        Tags that are read, in any directory.
    place : int, optional
        Where in the file the structure begins; its offsets count from there.
    """
    structure = Structure(file, place)
    main = _directory(structure, structure.first, wanted | {EXIF, GPS})
    exif = _directory(structure, _offset(main, EXIF), wanted | {INTEROPERABILITY})
    gps = _directory(structure, _offset(main, GPS), wanted)
    interoperability = _directory(structure, _offset(exif, INTEROPERABILITY), wanted)
    return StoredDirectories(main, exif, gps, interoperability)


def _directory(structure: Structure, offset: int, wanted: Set[int]) -> StoredFields:
    """Read the wanted fields of the directory at `offset`; 0 = there is none."""
    fields: StoredFields = {}
    with suppress(EOFError):
        for entry in structure.directory(offset)[1] if offset else ():
            if entry.tag not in wanted or entry.tag in fields:
                continue
            values = structure.values(entry, _LONGEST)
            if values and entry.kind in BYTES:
                fields[entry.tag] = StoredField(entry.kind, values)
            elif values and entry.size <= _LONGEST:
                numbers = structure.numbers(entry.kind, values)
                fields[entry.tag] = StoredField(entry.kind, numbers=numbers)
    return fields


def _offset(fields: StoredFields, tag: int) -> int:
    """Take the offset of a directory out of the fields; 0 if there is none."""
    offset, *_ = fields.pop(tag, StoredField(0)).numbers or (0,)
    return int(offset) if 0 < offset < 2**63 else 0


_TREE = (330, EXIF, GPS, INTEROPERABILITY)  # 330: SubIFDs

PLAIN: dict[str, Any] = {"is_lsm": False, "is_ndpi": False, "is_scanimage": False}
"""Arguments of `tifffile.TiffFile` that make it leave alone the kinds of files whose every page it
would read at once.
"""


_WHOLE = (
    "imagewidth imagelength imagedepth tilewidth tilelength tiledepth rowsperstrip samplesperpixel "
    "bitspersample compression photometric planarconfig subfiletype"
)


def check_page(page: Any) -> None:
    """Raise InputError unless the fields of a page of tifffile that say where and how large its
    samples are hold whole numbers: tifffile takes whatever kind of value a damaged file declares.
    """
    places, counts = page.dataoffsets, page.databytecounts
    stated = (*(getattr(page, name) for name in _WHOLE.split()), *places, *counts)
    if len(places) != len(counts) or not all(isinstance(number, int) for number in stated):
        raise InputError("damaged: its parts contradict each other; copy the file again")


def check_directories(file: IO[bytes], read: Container[int] | None = None, pages: int = 1) -> bool:
    """Raise InputError if a directory declares implausible sizes.

    Parameters
    ----------
    file : IO[bytes]
        Seekable; left at its beginning.
    read : Container[int] | None, optional
        Tags of the fields that will be read; None = all of them.
    pages : int, optional
        Number of pages to check, from the first on, and what is below them.

    Returns
    -------
    bool
        Whether the file has more than one page.
    """
    structure = Structure(file)
    end = structure.end
    try:
        if not structure.first:
            raise EOFError
        todo, seen, held, following, page = [structure.first], set[int](), 0, 0, structure.first
        while todo:
            if (place := todo.pop()) in seen:
                continue
            count, entries, after = structure.directory(place)
            check_count(count, "fields in a directory")
            if len(entries) < count:
                raise EOFError
            for entry in entries:
                if read is None or entry.tag in read or entry.tag in _TREE:
                    values = "bytes" if entry.kind in BYTES else "numbers"
                    things = "directories" if entry.tag in _TREE else values
                    check_count(entry.length, things, f" in field {entry.tag}")
                    held += min(end, entry.size)
                # LONG, IFD, LONG8 and IFD8 hold offsets
                if entry.tag in _TREE and entry.kind in (4, 13, 16, 18):
                    offsets = structure.values(entry, entry.size)
                    if len(offsets) < entry.size:
                        raise EOFError
                    below = map(int, structure.numbers(entry.kind, offsets))
                    # An offset beyond the end of the file is harmless: there is nothing to read.
                    todo += [offset for offset in below if offset < end]
            following = following if seen else after
            seen.add(place)
            if place == page and pages > 1 and 0 < after < end:
                pages, page = pages - 1, after
                todo.append(after)
            check_count(len(seen), "directories")
            check_count(-(-held // end), "times its length in fields")
        return following != 0
    except EOFError:
        reason = f"the file ends after {end} bytes, before its directory; copy the file again"
        raise InputError(f"damaged: {reason}") from None
    finally:
        file.seek(0)
