"""Checking the directories of an untrusted TIFF file (TIFF 6.0, BigTIFF) before a library parses them.

tifffile and Pillow create a Python object for every number that a field declares, and follow every directory that another names. A
malicious file of some megabytes can thus fill gigabytes of memory or keep them busy for hours.
"""

import struct
from collections.abc import Container, Sequence
from typing import IO, Any

from .errors import InputError

_SUB_IFDS, _EXIF, _GPS, _INTEROPERABILITY = 330, 34665, 34853, 40965
_TREE = (_SUB_IFDS, _EXIF, _GPS, _INTEROPERABILITY)
_OFFSETS = {4: "I", 13: "I", 16: "Q", 18: "Q"}  # field types that hold offsets of directories: LONG, IFD, LONG8, IFD8
_BYTES = (1, 2, 6, 7)
_SIZES = dict(zip(range(1, 19), (1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8), strict=True))  # bytes of a value, by type
_MOST_DIRECTORIES = 64
_MOST_FIELDS = 1024  # per directory; the largest in use have a hundred
_MOST_NUMBERS = 1 << 16  # per field: offsets of the 64 x 64 tiles of 268 megapixels, or of strips of one row
_MOST_BYTES = 16 << 20  # per field that is read
_MANY_PIECES, _LEAST_PIECE = 1 << 14, 1024  # more strips or tiles than this have that many pixels each
_MOST_OVERLAP = 4  # length of all fields that are read, in lengths of the file: they may share few bytes

PLAIN: dict[str, Any] = {"is_lsm": False, "is_ndpi": False, "is_scanimage": False}
"""Arguments of `tifffile.TiffFile` that make it leave alone the kinds of files whose every page it would read at once."""


def check_directories(file: IO[bytes], read: Container[int] | None = None, pages: int = 1) -> bool:
    """Raise InputError if a directory declares implausible sizes. Returns whether the file has more than one page.

    file: seekable; left at its beginning.
    read: tags of the fields that will be read; None = all of them.
    pages: number of pages to check, from the first on, and what is below them.
    """
    end = file.seek(0, 2)
    file.seek(0)
    try:
        header = file.read(16)
        order = {b"II": "<", b"MM": ">"}[header[:2]]
        big = struct.unpack_from(f"{order}H", header, 2)[0] == 43
        (first,) = struct.unpack_from(f"{order}Q" if big else f"{order}I", header, 8 if big else 4)
        todo, seen, held, following, page = [first], set[int](), 0, 0, first
        while todo:
            if (place := todo.pop()) in seen:
                continue
            below, after, fields = _directory(file, place, end, order, big, read)
            following = following if seen else after
            seen.add(place)
            if place == page and pages > 1 and 0 < after < end:
                pages, page = pages - 1, after
                below.append(after)
            todo, held = todo + below, held + fields
            if len(seen) > _MOST_DIRECTORIES:
                raise _excessive(f"more than {_MOST_DIRECTORIES} directories")
            if held > _MOST_OVERLAP * end:
                raise _excessive(f"fields of {held} bytes in {end} bytes")
        return following != 0
    except (KeyError, EOFError, struct.error):
        raise InputError(f"damaged: the file ends after {end} bytes, before its directory; copy the file again") from None
    finally:
        file.seek(0)


def check_pieces(offsets: Sequence[int], lengths: Sequence[int], end: int, pixels: int) -> None:
    """Raise InputError unless the strips or tiles of a picture lie in the file, share no bytes, and are not needlessly many.

    offsets, lengths: of the strips or tiles, bytes.
    end: length of the file.
    pixels: of the picture.
    """
    # tifffile fills missing data with zeros: a black stripe in the picture instead of an error.
    if not offsets or any(not length or offset + length > end for offset, length in zip(offsets, lengths, strict=True)):
        raise InputError("the picture is cut short: it points beyond the end of the file; copy it again")
    if sum(lengths) > end:
        raise InputError("the strips of the picture overlap: the file is damaged, or made to fill the memory")
    if len(offsets) > _MANY_PIECES and len(offsets) * _LEAST_PIECE > pixels:
        raise InputError(f"{pixels} pixels in {len(offsets)} strips: the file is damaged, or made to waste time; save it again")


def _directory(
    file: IO[bytes], place: int, end: int, order: str, big: bool, read: Container[int] | None
) -> tuple[list[int], int, int]:
    """Offsets of the directories below the one at offset `place`, offset of the next one (0 = none), bytes of the fields."""
    count_letter, number, entry = ("Q", "Q", struct.Struct(f"{order}HHQ8s")) if big else ("H", "I", struct.Struct(f"{order}HHI4s"))
    file.seek(place)
    (count,) = struct.unpack(order + count_letter, file.read(struct.calcsize(order + count_letter)))
    if count > _MOST_FIELDS:
        raise _excessive(f"{count} fields in a directory")
    table = file.read(count * entry.size)
    if len(table) < count * entry.size:
        raise EOFError
    after = file.read(struct.calcsize(order + number))
    below: list[int] = []
    held = 0
    for code, kind, length, value in entry.iter_unpack(table):
        if read is None or code in read or code in _TREE:
            _check_field(code, kind, length)
            held += min(end, length * _SIZES.get(kind, 0))
        if code in _TREE and kind in _OFFSETS:
            size = length * struct.calcsize(order + _OFFSETS[kind])
            if size > len(value):
                file.seek(struct.unpack(order + number, value)[0])
                value = file.read(size)  # noqa: PLW2901  the offsets themselves instead of their place
            below += struct.unpack_from(f"{order}{length}{_OFFSETS[kind]}", value)
    # An offset beyond the end of the file is harmless: there is nothing to read.
    return [each for each in below if each < end], struct.unpack(order + number, after)[0] if after else 0, held


def _check_field(code: int, kind: int, length: int) -> None:
    if code in _TREE and length > _MOST_DIRECTORIES:
        raise _excessive(f"{length} directories in field {code}")
    if kind in _BYTES and length > _MOST_BYTES:
        raise _excessive(f"{length} bytes in field {code}")
    if kind not in _BYTES and length > _MOST_NUMBERS:
        raise _excessive(f"{length} numbers in field {code}")


def _excessive(what: str) -> InputError:
    return InputError(f"the file declares {what}, more than any picture has: it is damaged or malicious; copy it again")
