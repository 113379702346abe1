"""Capture metadata as TIFF, Exif and GPS fields (Exif 2.3, section 4.6), for every format that
holds them.

Other programs write and edit these fields, and what they hold goes into every result. So texts that
are read lose control characters and length, and an invalid field counts as missing; it is never an
error.
"""

import html
import math
import re
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import IO, Any
from unicodedata import category

from ..errors import InputError
from ..metadata import CaptureMetadata
from ..tiff import Directory, Fields, FieldType
from ..tiff_reading import StoredDirectories, StoredField, StoredFields, read_directories
from .tags import GPS, MAKER, TAG, fields_of, tags_of

LARGEST_SHORT = 65535
_ANGLES = (GPS["GPSLatitude"], "NS"), (GPS["GPSLongitude"], "EW")
# Field of CaptureMetadata -> tag of its text in the first directory.
TEXTS = {name.lower(): TAG[name] for name in ("Make", "Model", "Artist", "Copyright")}
TEXTS["description"] = TAG["ImageDescription"]
# Field of CaptureMetadata -> tag of its number in the Exif directory.
NUMBERS = {"exposure_time": TAG["ExposureTime"], "f_number": TAG["FNumber"]}
NUMBERS["focal_length"] = TAG["FocalLength"]
_LONGEST = 4096  # bytes of a text: all fields together fit into the 64 KiB of a JPEG's Exif block
# what tifffile, ImageJ and OME's programs write about arrays in place of a caption
_ABOUT_ARRAYS = '{"shape": ', "shape=(", "ImageJ=", "<?xml", "<OME"
_JOINERS = "\u200c\u200d"  # the only format characters that names need
_XMP_TEXT = rb"""tiff:%b\s*(?:=\s*"([^"<]*)"|=\s*'([^'<]*)'|>([^<]*)<)"""

_TIME_FIELDS = "DateTime", "SubsecTime", "OffsetTime"
_TIMES = "Original", "Digitized", ""  # ends of the names of their fields
_SENSITIVITIES = "ISOSpeed", "RecommendedExposureIndex", "StandardOutputSensitivity"
_OTHERS = "LensModel Orientation ISOSpeedRatings XMP UniqueCameraModel " + " ".join(_SENSITIVITIES)
# 0 to 6: GPS
WANTED = frozenset({*TEXTS.values(), *NUMBERS.values(), *tags_of(_OTHERS), *range(7)})
WANTED |= {TAG[f"{name}{kind}"] for name in _TIME_FIELDS for kind in _TIMES}
"""The tags that `metadata_from` looks at."""


def metadata_directory(metadata: CaptureMetadata) -> Directory:
    """A directory with the capture metadata, and the Exif and GPS directories below it. The caller
    adds the fields of the picture.

    Texts are UTF-8 (readers strip blanks around them), numbers are fractions of 31-bit integers.
    Unknown metadata have no field.
    """
    exif = Directory(fields_of(FieldType.UNDEFINED, ExifVersion=b"0232"))
    main = Directory(fields_of(FieldType.ASCII, Software=MAKER))
    # TIFF and Exif require a resolution; Exif prescribes this one if it is unknown.
    main.fields |= fields_of(FieldType.RATIONAL, XResolution=[72], YResolution=[72])
    orientation = [metadata.orientation]
    main.fields |= fields_of(FieldType.SHORT, Orientation=orientation, ResolutionUnit=[2])  # inch
    for name, tag in TEXTS.items():
        if text := getattr(metadata, name):
            main.fields[tag] = FieldType.ASCII, text
    if metadata.lens:
        exif.fields |= fields_of(FieldType.ASCII, LensModel=metadata.lens)
    for name, tag in NUMBERS.items():
        if (number := getattr(metadata, name)) is not None:
            exif.fields[tag] = FieldType.RATIONAL, [number]
    if metadata.iso is not None:
        exif.fields[TAG["ISOSpeedRatings"]] = FieldType.SHORT, [min(metadata.iso, LARGEST_SHORT)]
        if metadata.iso >= LARGEST_SHORT:  # Exif 2.3, Annex G; 3: the figure is an ISO speed
            exif.fields |= fields_of(FieldType.SHORT, SensitivityType=[3])
            exif.fields |= fields_of(FieldType.LONG, ISOSpeed=[metadata.iso])
    if metadata.taken is not None:
        # isoformat, because strftime("%Y") does not fill up the year 987 on every system.
        seconds = metadata.taken.replace(tzinfo=None).isoformat(" ", "seconds").replace("-", ":")
        main.fields[TAG["DateTime"]] = FieldType.ASCII, seconds
        exif.fields[TAG["DateTimeOriginal"]] = FieldType.ASCII, seconds
        if metadata.taken.microsecond:
            decimals = f"{metadata.taken.microsecond:06}".rstrip("0")
            exif.fields[TAG["SubsecTimeOriginal"]] = FieldType.ASCII, decimals
    if metadata.zone:
        exif.fields[TAG["OffsetTimeOriginal"]] = FieldType.ASCII, metadata.zone
    main.children[TAG["ExifTag"]] = exif
    if gps := _gps_fields(metadata):
        gps[GPS["GPSVersionID"]] = FieldType.BYTE, bytes([2, 3, 0, 0])
        main.children[TAG["GPSTag"]] = Directory(gps)
    return main


def _gps_fields(metadata: CaptureMetadata) -> Fields:
    """Return the fields of place and altitude, as far as they are known."""
    fields: Fields = {}
    for (tag, letters), angle in zip(_ANGLES, metadata.place or (), strict=False):
        minutes, seconds = divmod(abs(angle) * 3600, 60)
        degrees, minutes = divmod(minutes, 60)
        fields[tag - 1] = FieldType.ASCII, letters[angle < 0]
        fields[tag] = FieldType.RATIONAL, [degrees, minutes, round(seconds, 5)]  # to a millimetre
    if metadata.altitude is not None:
        fields[GPS["GPSAltitudeRef"]] = FieldType.BYTE, bytes([metadata.altitude < 0])
        fields[GPS["GPSAltitude"]] = FieldType.RATIONAL, [abs(metadata.altitude)]
    return fields


def read_metadata(file: IO[bytes]) -> CaptureMetadata:
    """The capture metadata in a TIFF structure; nothing is known of any other file."""
    return metadata_from(read_directories(file, WANTED))


def metadata_from(stored: StoredDirectories) -> CaptureMetadata:
    """Return the capture metadata in the fields of a file; read with `WANTED` or more."""
    # TIFF/EP, and so DNG, has Exif's fields in the first directory too.
    main, exif = stored.main, stored.main | stored.exif
    iso = _number(exif, TAG["ISOSpeedRatings"])
    if iso == LARGEST_SHORT:
        iso = next(filter(None, (_number(exif, TAG[name]) for name in _SENSITIVITIES)), iso)
    times = [(_time(exif, kind), text(exif, TAG[f"OffsetTime{kind}"])) for kind in _TIMES]
    taken = next((time for time, _ in times if time), None)
    # the zone of an edit on another day is not that of the exposure
    day = taken and taken.date()
    zones = [zone for time, zone in times if (time and time.date()) == day]
    values: dict[str, Any] = {
        **{name: text(main, tag) for name, tag in TEXTS.items()},
        **{name: _number(exif, tag) for name, tag in NUMBERS.items()},
        "lens": text(exif, TAG["LensModel"]),
        "taken": taken,
        "zone": next(filter(None, zones), ""),
        "place": _place(stored.gps),
        "altitude": _altitude(stored.gps),
        "iso": None if iso is None else round(iso),
        "orientation": int(_number(main, TAG["Orientation"]) or 1),
    }
    if text(main, TAG["UniqueCameraModel"]).startswith(MAKER):
        # In a DNG of ours the camera is ours, unless somebody has edited it. The source is in the
        # XMP: see `main_directory`.
        ours = (name for name in ("make", "model") if values[name].startswith(MAKER))
        values |= {name: _xmp_text(main, name.capitalize()) for name in ours}
    if values["description"].startswith(_ABOUT_ARRAYS):
        del values["description"]
    metadata = CaptureMetadata()
    for name, value in values.items():
        with suppress(InputError):
            metadata = replace(metadata, **{name: value})
    return metadata


def text(fields: StoredFields, tag: int) -> str:
    """Return the printable text of a field of bytes; "" if it has none. Longer texts are cut off at
    4096 bytes of UTF-8.
    """
    data = fields.get(tag, StoredField(0)).data
    if len(data) > 2 * _LONGEST:  # enough, and without half a letter of UTF-8 at the end
        data = data[: 2 * _LONGEST].rstrip(bytes(range(0x80, 0xC0)))[:-1]
    # A NUL separates the photographer from the editor in Copyright, and ends every text.
    texts = (printable(_decoded(text)) for text in data.split(b"\0"))
    return "; ".join(filter(None, texts)).encode()[:_LONGEST].decode(errors="ignore")


def printable(value: str) -> str:
    """Return the text without what does harm on a terminal or in XML: control, format and private
    characters, lone surrogates.
    """
    # control characters, and separators of lines and paragraphs: categories Cc, Zl and Zp
    spaced = re.sub(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]", " ", value)
    kept = (letter for letter in spaced if letter in _JOINERS or category(letter)[0] != "C")
    return "".join(kept).strip()


def _decoded(data: bytes) -> str:
    """Decode a text: Exif prescribes ASCII; programs write UTF-8, and old ones what Windows had."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def _number(fields: StoredFields, tag: int) -> float | None:
    """Return the first number of a field if it is positive and finite."""
    number, *_ = fields.get(tag, StoredField(0)).numbers or (math.nan,)
    return number if math.isfinite(number) and number > 0 else None


def _time(fields: StoredFields, kind: str) -> datetime | None:
    """Return date and time of a kind of `_TIMES`, from "YYYY:MM:DD HH:MM:SS" and the decimals of
    the second; None if it is not one.
    """
    try:
        stated = text(fields, TAG[f"DateTime{kind}"])[:19]
        taken = datetime.strptime(stated, "%Y:%m:%d %H:%M:%S")  # noqa: DTZ007  Exif has local time
    except ValueError:
        return None
    digits = re.fullmatch("[0-9]+", text(fields, TAG[f"SubsecTime{kind}"]))
    return taken.replace(microsecond=int(f"{digits[0]:0<6}"[:6])) if digits else taken


def _xmp_text(fields: StoredFields, name: str) -> str:
    match = re.search(_XMP_TEXT % name.encode(), fields.get(TAG["XMP"], StoredField(0)).data)
    stated = b"".join(filter(None, match.groups())) if match else b""
    return printable(html.unescape(stated.decode(errors="replace")))[:_LONGEST]


def _place(gps: StoredFields) -> tuple[float, float] | None:
    """Return latitude and longitude in degrees; None unless both are whole, for half a position is
    a wrong one.
    """
    angles = []
    for tag, letters in _ANGLES:
        reference, field = text(gps, tag - 1), gps.get(tag, StoredField(0))
        is_angle = field.kind == FieldType.RATIONAL and len(field.numbers) == 3
        if not is_angle or reference not in tuple(letters):
            return None
        degrees, *rest = field.numbers
        # some write 0/0 for what they do not state
        minutes, seconds = (0 if math.isnan(value) else value for value in rest)
        angle = round(degrees + minutes / 60 + seconds / 3600, 8)  # to a millimetre
        angles.append(-angle if reference == letters[1] else angle)
    return angles[0], angles[1]


def _altitude(gps: StoredFields) -> float | None:
    """Return the metres above the sea; None unless it is clear whether they are above or below."""
    field = gps.get(GPS["GPSAltitude"])
    below = gps.get(GPS["GPSAltitudeRef"], StoredField(0, b"\0")).data
    if field is None or field.kind != FieldType.RATIONAL or below not in (b"\0", b"\1"):
        return None
    return -field.numbers[0] if below == b"\1" else field.numbers[0]
