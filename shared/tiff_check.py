"""Checking the directories of an untrusted TIFF file (TIFF 6.0, BigTIFF) before a library parses
them.

tifffile and Pillow create a Python object for every number that a field declares, and follow every
directory that another names. A malicious file of some megabytes can thus fill gigabytes of memory
or keep them busy for hours.
"""

from collections.abc import Container
from typing import IO, Any

from .errors import InputError
from .limits import check_count
from .tiff_reading import BYTES, EXIF, GPS, INTEROPERABILITY, Structure

_TREE = (330, EXIF, GPS, INTEROPERABILITY)  # 330: SubIFDs
_OFFSETS = (4, 13, 16, 18)  # field types that hold offsets of directories: LONG, IFD, LONG8, IFD8

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
            below, after, fields = _directory(structure, place, read)
            following = following if seen else after
            seen.add(place)
            if place == page and pages > 1 and 0 < after < end:
                pages, page = pages - 1, after
                below.append(after)
            todo, held = todo + below, held + fields
            check_count(len(seen), "directories")
            check_count(-(-held // end), "times its length in fields")
        return following != 0
    except EOFError:
        reason = f"the file ends after {end} bytes, before its directory; copy the file again"
        raise InputError(f"damaged: {reason}") from None
    finally:
        file.seek(0)


def _directory(
    structure: Structure, place: int, read: Container[int] | None
) -> tuple[list[int], int, int]:
    """Offsets of the directories below the one at offset `place`, that of the next one, and bytes
    of its fields.
    """
    count, entries, after = structure.directory(place)
    check_count(count, "fields in a directory")
    if len(entries) < count:
        raise EOFError
    below: list[int] = []
    held = 0
    for entry in entries:
        if read is None or entry.tag in read or entry.tag in _TREE:
            values = "bytes" if entry.kind in BYTES else "numbers"
            things = "directories" if entry.tag in _TREE else values
            check_count(entry.length, things, f" in field {entry.tag}")
            held += min(structure.end, entry.size)
        if entry.tag in _TREE and entry.kind in _OFFSETS:
            offsets = structure.values(entry, entry.size)
            if len(offsets) < entry.size:
                raise EOFError
            below += map(int, structure.numbers(entry.kind, offsets))
    # An offset beyond the end of the file is harmless: there is nothing to read.
    return [offset for offset in below if offset < structure.end], after, held
