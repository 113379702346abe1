"""Corrections that a DNG asks for (DNG 1.7.1, chapter 7), such as a gain map against dark corners: a scene is made without them."""

from pathlib import Path
from typing import Any

from tifffile import TIFF, TiffFile

from ...shared.tiff_check import PLAIN, check_directories

_LISTS = (51008, 51009, 51022)  # OpcodeList1 to 3
# From number 1 on.
# fmt: off
_NAMES = (
    "WarpRectilinear", "WarpFisheye", "FixVignetteRadial", "FixBadPixelsConstant",
    "FixBadPixelsList", "TrimBounds", "MapTable", "MapPolynomial", "GainMap",
    "DeltaPerRow", "DeltaPerColumn", "ScalePerRow", "ScalePerColumn", "WarpRectilinear2",
)
# fmt: on
_HEAD = 16  # bytes of an opcode: its number, version, flags and length


def remark_on_opcodes(path: Path) -> tuple[str, ...]:
    """One note for the user on the corrections that a DNG asks for; none if it asks for none. Raises whatever tifffile raises."""
    with path.open("rb") as stream:
        check_directories(stream, {*TIFF.TAG_LOAD, *_LISTS})
    with TiffFile(path, **PLAIN) as file:
        first: Any = file.pages[0]
        pages = [page for page in (first, *(first.pages or ())) if page.subfiletype == 0]  # previews have none
        lists = [bytes(page.tags[tag].value) for page in pages for tag in _LISTS if tag in page.tags]
    names = dict.fromkeys(name for opcodes in lists for name in _names(opcodes))
    if not names:
        return ()
    return (f"the file asks for corrections that are not made ({', '.join(names)}): a linear TIFF of a raw developer has them",)


def _names(opcodes: bytes) -> list[str]:
    found, place, count = list[str](), 4, int.from_bytes(opcodes[:4], "big")
    while place + _HEAD <= len(opcodes) and len(found) < min(count, 1024):
        number, length = (int.from_bytes(opcodes[start : start + 4], "big") for start in (place, place + 12))
        found.append(_NAMES[number - 1] if 1 <= number <= len(_NAMES) else f"opcode {number}")
        place += _HEAD + length
    return found
