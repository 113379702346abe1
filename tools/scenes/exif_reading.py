"""Capture data out of Exif blocks and TIFF directories; whatever is odd is left out, never fatal."""

import math
import warnings
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from shared import CaptureMetadata
from shared.tiff_check import check_directories

# TIFF 6.0 section 8 and Exif 2.3 section 4.6
DESCRIPTION, MAKE, MODEL, ORIENTATION, DATE_TIME, ARTIST, EXIF_IFD = 270, 271, 272, 274, 306, 315, 34665
EXPOSURE_TIME, F_NUMBER, ISO, DATE_TIME_ORIGINAL, FOCAL_LENGTH, LENS_MODEL = 33434, 33437, 34855, 36867, 37386, 42036


def from_tags(tags: Mapping[int, Any]) -> CaptureMetadata:
    """Metadata from the tags of a first directory and its Exif directory, merged."""
    return CaptureMetadata(
        make=text(tags.get(MAKE)),
        model=text(tags.get(MODEL)),
        lens=text(tags.get(LENS_MODEL)),
        artist=text(tags.get(ARTIST)),
        description=text(tags.get(DESCRIPTION)),
        taken=moment(tags.get(DATE_TIME_ORIGINAL)) or moment(tags.get(DATE_TIME)),
        exposure_time=positive(tags.get(EXPOSURE_TIME)),
        f_number=positive(tags.get(F_NUMBER)),
        iso=whole(tags.get(ISO)),
        focal_length=positive(tags.get(FOCAL_LENGTH)),
        orientation=orientation(tags.get(ORIENTATION)),
    )


def merged(exif: Any) -> dict[int, Any]:
    """Tags of a Pillow `Exif`: the first directory's and the Exif directory's."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # capture data are a courtesy: what is odd is left out without a word
        try:
            return {**dict(exif), **exif.get_ifd(EXIF_IFD)}
        except Exception:  # hostile directories raise all sorts
            return {}


def tiff_tags(path: Path) -> dict[int, Any]:
    """Tags of a TIFF-based file, a camera RAW as well; empty when the file has another structure or a damaged one."""
    from PIL import Image

    exif = Image.Exif()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as above
        try:
            with path.open("rb") as file:
                check_directories(file)
                exif.load_from_fp(file)
                return merged(exif)
        except Exception:
            return {}


def text(value: object) -> str:
    """Printable text of a field; "" for anything else. A multiple field gives its first."""
    value = _first(value)
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    if not isinstance(value, str):
        return ""
    return "".join(letter for letter in value.split("\0")[0] if letter.isprintable()).strip()


def positive(value: object) -> float | None:
    """A positive, finite number that metadata can hold, or None."""
    try:
        number = float(_first(value))  # type: ignore[arg-type]
    except (TypeError, ValueError, ArithmeticError):
        return None
    return number if math.isfinite(number) and 0 < number < 2**31 else None


def whole(value: object) -> int | None:
    """A positive whole number, or None."""
    number = positive(value)
    return round(number) if number and round(number) >= 1 else None


def moment(value: object) -> datetime | None:
    """Exif's "YYYY:MM:DD HH:MM:SS", local time without zone, or None."""
    try:
        return datetime.strptime(text(value)[:19], "%Y:%m:%d %H:%M:%S")  # noqa: DTZ007 -- Exif knows no zone
    except ValueError:
        return None


def orientation(value: object) -> int:
    """A TIFF orientation; 1 when the field is missing or odd."""
    value = _first(value)
    return value if isinstance(value, int) and value in range(1, 9) else 1


def _first(value: object) -> object:
    return value[0] if isinstance(value, tuple | list) and value else value
