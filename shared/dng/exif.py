"""Convert capture metadata to TIFF and Exif fields (Exif 2.3, section 4.6) and back, for every format that holds them."""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import Any

from ..errors import InputError
from ..metadata import CaptureMetadata
from ..tiff import Directory, Fields, FieldType, encode_tiff
from .tags import MAKER, Tag

_TIME = "%Y:%m:%d %H:%M:%S"
_LARGEST_SHORT = 65535
_INCH = 2  # ResolutionUnit
_ISO_SPEED_ALONE = 3  # SensitivityType: the figure is an ISO speed

# Field of CaptureMetadata -> tag of its text in the first directory.
_TEXTS = {"make": Tag.MAKE, "model": Tag.MODEL, "artist": Tag.ARTIST, "description": Tag.IMAGE_DESCRIPTION}
# Field of CaptureMetadata -> its number in the Exif directory: the tag, and its name in tifffile.
_NUMBERS = {
    "exposure_time": (Tag.EXPOSURE_TIME, "ExposureTime"),
    "f_number": (Tag.F_NUMBER, "FNumber"),
    "focal_length": (Tag.FOCAL_LENGTH, "FocalLength"),
}


def metadata_directory(metadata: CaptureMetadata) -> Directory:
    """A directory with the capture metadata, and the Exif directory below it. The caller adds the fields of the picture.

    Texts are UTF-8 (readers strip blanks around them), numbers are fractions of 31-bit integers. Unknown metadata have no field.
    """
    main = Directory({Tag.ORIENTATION: (FieldType.SHORT, [metadata.orientation]), Tag.SOFTWARE: (FieldType.ASCII, MAKER)})
    exif = Directory({Tag.EXIF_VERSION: (FieldType.UNDEFINED, b"0230")})
    for name, tag in _TEXTS.items():
        if text := getattr(metadata, name):
            main.fields[tag] = FieldType.ASCII, text
    if metadata.lens:
        exif.fields[Tag.LENS_MODEL] = FieldType.ASCII, metadata.lens
    for name, (tag, _) in _NUMBERS.items():
        if (number := getattr(metadata, name)) is not None:
            exif.fields[tag] = FieldType.RATIONAL, [number]
    if metadata.iso is not None:
        exif.fields[Tag.ISO_SPEED_RATINGS] = FieldType.SHORT, [min(metadata.iso, _LARGEST_SHORT)]
        if metadata.iso >= _LARGEST_SHORT:  # Exif 2.3, Annex G
            exif.fields[Tag.SENSITIVITY_TYPE] = FieldType.SHORT, [_ISO_SPEED_ALONE]
            exif.fields[Tag.ISO_SPEED] = FieldType.LONG, [metadata.iso]
    if metadata.taken is not None:
        # isoformat, because strftime("%Y") does not fill up the year 987 on every system.
        seconds = metadata.taken.replace(tzinfo=None).isoformat(" ", "seconds").replace("-", ":")
        main.fields[Tag.DATE_TIME] = FieldType.ASCII, seconds
        exif.fields[Tag.DATE_TIME_ORIGINAL] = FieldType.ASCII, seconds
        if metadata.taken.microsecond:
            exif.fields[Tag.SUB_SEC_TIME_ORIGINAL] = FieldType.ASCII, f"{metadata.taken.microsecond:06}"
    main.children[Tag.EXIF_IFD] = exif
    return main


def exif_block(metadata: CaptureMetadata) -> bytes:
    """The metadata as the Exif block of a picture file: a TIFF structure, without the "Exif" and two NULs of a JPEG segment."""
    directory = metadata_directory(metadata)
    directory.fields.update(resolution_fields())
    return encode_tiff(directory)


def resolution_fields() -> Fields:
    """Fields of the resolution, which TIFF and Exif require: 72 pixels per inch, as Exif prescribes if it is unknown."""
    return {
        Tag.X_RESOLUTION: (FieldType.RATIONAL, [72]),
        Tag.Y_RESOLUTION: (FieldType.RATIONAL, [72]),
        Tag.RESOLUTION_UNIT: (FieldType.SHORT, [_INCH]),
    }


def read_metadata(main: Callable[[int], Any], exif: Mapping[str, Any]) -> CaptureMetadata:
    """The capture metadata of a file.

    main: returns the value of a tag in the first directory, or None.
    exif: the Exif directory, by the names of Exif.
    Never fails: other programs edit these fields, and an invalid one must not make the picture unreadable; it counts as missing.
    """
    iso, orientation = _number(exif.get("ISOSpeedRatings")), _number(main(Tag.ORIENTATION))
    if iso == _LARGEST_SHORT:
        iso = _number(exif.get("ISOSpeed")) or iso
    found: dict[str, Any] = {
        **{name: _text(main(tag)) for name, tag in _TEXTS.items()},
        **{name: _number(exif.get(key)) for name, (_, key) in _NUMBERS.items()},
        "lens": _text(exif.get("LensModel")),
        "taken": _time(exif.get("DateTimeOriginal"), exif.get("SubsecTimeOriginal")) or _time(main(Tag.DATE_TIME), None),
        "iso": None if iso is None else int(iso),
        "orientation": 1 if orientation is None else int(orientation),
    }
    metadata = CaptureMetadata()
    for name, value in found.items():
        with suppress(InputError):
            metadata = replace(metadata, **{name: value})
    return metadata


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _number(value: Any) -> float | None:
    """A positive number from a TIFF value, which is a number or (numerator, denominator); None if it is not one."""
    try:
        number = value[0] / value[1] if isinstance(value, tuple) else value
        return number if math.isfinite(number) and number > 0 else None
    except (TypeError, IndexError, ZeroDivisionError):
        return None


def _time(value: Any, digits: Any) -> datetime | None:
    """Date and time from "YYYY:MM:DD HH:MM:SS" and the decimals of the second; None if it is not one."""
    try:
        taken = datetime.strptime(_text(value).strip(), _TIME)  # noqa: DTZ007  Exif has local time without zone
    except ValueError:
        return None
    decimals = _text(digits).strip()
    return taken.replace(microsecond=int(f"{decimals:0<6}"[:6])) if decimals.isdecimal() and decimals.isascii() else taken
