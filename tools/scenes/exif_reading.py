"""Capture data from Exif blocks and TIFF directories. Invalid fields are skipped: they are never an error."""

import warnings
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from shared import CaptureMetadata
from shared.dng.tags import Tag
from shared.tiff_check import check_directories


def from_tags(tags: Mapping[int, Any]) -> CaptureMetadata:
    """Return the capture data in `tags`: those of a first directory and its Exif directory, merged."""
    return CaptureMetadata(
        make=text(tags.get(Tag.MAKE)),
        model=text(tags.get(Tag.MODEL)),
        lens=text(tags.get(Tag.LENS_MODEL)),
        artist=text(tags.get(Tag.ARTIST)),
        description=text(tags.get(Tag.IMAGE_DESCRIPTION)),
        taken=moment(tags.get(Tag.DATE_TIME_ORIGINAL)) or moment(tags.get(Tag.DATE_TIME)),
        exposure_time=positive(tags.get(Tag.EXPOSURE_TIME)),
        f_number=positive(tags.get(Tag.F_NUMBER)),
        iso=whole(tags.get(Tag.ISO_SPEED_RATINGS)),
        focal_length=positive(tags.get(Tag.FOCAL_LENGTH)),
        orientation=orientation(tags.get(Tag.ORIENTATION)),
    )


def exif_tags(block: bytes) -> dict[int, Any]:
    """Return the tags of an Exif block, with or without its prefix; empty if they are damaged."""
    return _tags(BytesIO(block.removeprefix(b"Exif\0\0")))


def tiff_tags(path: Path) -> dict[int, Any]:
    """Return the tags of a file based on TIFF, as most camera RAWs are; empty if it has another or a damaged structure."""
    with suppress(OSError), path.open("rb") as file:
        return _tags(file)
    return {}


def _tags(file: IO[bytes]) -> dict[int, Any]:
    """Return the tags of the first directory and of its Exif directory."""
    from PIL import Image

    exif = Image.Exif()
    # Capture data are optional, so warnings are dropped; hostile directories raise all kinds of exceptions.
    with suppress(Exception), warnings.catch_warnings(action="ignore"):
        check_directories(file)
        exif.load_from_fp(file)
        return {**dict(exif), **exif.get_ifd(Tag.EXIF_IFD)}
    return {}


def text(value: object) -> str:
    """Return the printable text of a field, or "" if it has none. Of several values the first is used."""
    value = _first(value)
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    if not isinstance(value, str):
        return ""
    return "".join(letter for letter in value.split("\0")[0] if letter.isprintable()).strip()


def positive(value: object) -> float | None:
    """Return the value if it is a positive, finite number that fits `CaptureMetadata`, otherwise None."""
    with suppress(TypeError, ValueError, ArithmeticError):
        number = float(_first(value))  # type: ignore[arg-type]
        return number if 0 < number < 2**31 else None
    return None


def whole(value: object) -> int | None:
    """Return the value rounded to a positive whole number, or None."""
    number = positive(value)
    return round(number) if number and round(number) >= 1 else None


def moment(value: object) -> datetime | None:
    """Return the time in Exif's form "YYYY:MM:DD HH:MM:SS" (local time without zone), or None."""
    with suppress(ValueError):
        return datetime.strptime(text(value)[:19], "%Y:%m:%d %H:%M:%S")  # noqa: DTZ007 -- Exif knows no zone
    return None


def orientation(value: object) -> int:
    """Return a TIFF orientation, 1 to 8; 1 if the field is missing or invalid."""
    value = _first(value)
    return value if isinstance(value, int) and value in range(1, 9) else 1


def _first(value: object) -> object:
    return value[0] if isinstance(value, tuple | list) and value else value
