"""Checking the directories of an untrusted TIFF file (TIFF 6.0, BigTIFF) before a library parses them.

tifffile and Pillow create a Python object for every number that a field declares, and follow every directory that another names. A
malicious file of some megabytes can thus fill gigabytes of memory or keep them busy for hours.
"""

from collections.abc import Container, Sequence
from typing import IO, Any

from .errors import InputError
from .tiff_reading import BYTES, MOST_FIELDS, Entry, Structure

_SUB_IFDS, _EXIF, _GPS, _INTEROPERABILITY = 330, 34665, 34853, 40965
_TREE = (_SUB_IFDS, _EXIF, _GPS, _INTEROPERABILITY)
_OFFSETS = (4, 13, 16, 18)  # field types that hold offsets of directories: LONG, IFD, LONG8, IFD8
_MOST_DIRECTORIES = 64
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
    structure = Structure(file)
    end = structure.end
    try:
        if not structure.first:
            raise EOFError
        todo, seen, held, following, page = [structure.first], set[int](), 0, 0, structure.first
        while todo:
            if (place := todo.pop()) in seen:
                continue
            below, after, fields = _directory(structure, place, read)
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
    except EOFError:
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


def _directory(structure: Structure, place: int, read: Container[int] | None) -> tuple[list[int], int, int]:
    """Offsets of the directories below the one at offset `place`, that of the next one, and bytes of its fields."""
    count, entries, after = structure.directory(place)
    if count > MOST_FIELDS:
        raise _excessive(f"{count} fields in a directory")
    if len(entries) < count:
        raise EOFError
    below: list[int] = []
    held = 0
    for entry in entries:
        if read is None or entry.tag in read or entry.tag in _TREE:
            _check_field(entry)
            held += min(structure.end, entry.size)
        if entry.tag in _TREE and entry.kind in _OFFSETS:
            offsets = structure.values(entry)
            if len(offsets) < entry.size:
                raise EOFError
            below += map(int, structure.numbers(entry.kind, offsets))
    # An offset beyond the end of the file is harmless: there is nothing to read.
    return [each for each in below if each < structure.end], after, held


def _check_field(entry: Entry) -> None:
    if entry.tag in _TREE:
        most, things = _MOST_DIRECTORIES, "directories"
    else:
        most, things = (_MOST_BYTES, "bytes") if entry.kind in BYTES else (_MOST_NUMBERS, "numbers")
    if entry.length > most:
        raise _excessive(f"{entry.length} {things} in field {entry.tag}")


def _excessive(what: str) -> InputError:
    return InputError(f"the file declares {what}, more than any picture has: it is damaged or malicious; copy it again")
