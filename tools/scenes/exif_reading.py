"""Capture data in the files that scenes come from. Invalid fields are skipped: they are never an error."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

from shared import CaptureMetadata
from shared.dng import read_metadata
from shared.dng.exif_reading import WANTED
from shared.dng.tags import Tag
from shared.tiff_reading import StoredDirectories, read_directories

_COLOURS = {Tag.COLOR_MATRIX_1, Tag.COLOR_MATRIX_2, Tag.CALIBRATION_ILLUMINANT_1, Tag.CALIBRATION_ILLUMINANT_2}
_START = b"Exif\0\0"
_SEARCHED = 1 << 20  # bytes at the beginning of a RAW that is not a TIFF
_TIFF_STARTS = (b"II*\0\x08\0\0\0", b"MM\0*\0\0\0\x08")


def tiff_metadata(path: Path) -> CaptureMetadata:
    """Return the capture data of a file based on TIFF."""
    with path.open("rb") as file:
        return read_metadata(file)


def raw_directories(path: Path) -> StoredDirectories:
    """Return the capture data and colour matrices of a camera RAW, as fields.

    Most RAWs are based on TIFF. Others begin with a preview or a box that holds a whole TIFF structure (RAF, RW2, MRW, CR3).
    """
    with path.open("rb") as file:
        found = read_directories(file, WANTED | _COLOURS)
        if found.main or found.exif:
            return found
        file.seek(0)
        start = file.read(_SEARCHED)
        places = sorted(place for mark in _TIFF_STARTS if (place := start.find(mark)) >= 0)
        return read_directories(file, WANTED, places[0]) if places else found


def picture_metadata(info: Mapping[Any, Any]) -> CaptureMetadata:
    """Return the capture data in what Pillow's `Image.info` holds of a JPEG or PNG."""
    block = info.get("exif", b"")
    return read_metadata(BytesIO(block.removeprefix(_START))) if isinstance(block, bytes) else CaptureMetadata()
