"""Read capture metadata from the TIFF, Exif and GPS fields of any file. An invalid field counts as missing; it is never an error.

Other programs write and edit these fields, and what they hold goes into every result. So texts lose control characters and length.
"""

import html
import math
import re
import unicodedata
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import IO, Any

from ..errors import InputError
from ..metadata import CaptureMetadata
from ..tiff import FieldType
from ..tiff_reading import StoredDirectories, StoredField, StoredFields, read_directories
from .exif import LARGEST_SHORT, NUMBERS, TEXTS
from .tags import MAKER, GpsTag, Tag

_TIME = "%Y:%m:%d %H:%M:%S"
_LONGEST = 4096  # bytes of a text: all fields together fit into the 64 KiB of a JPEG's Exif block
_CONTINUATIONS = bytes(range(0x80, 0xC0))  # of letters in UTF-8
_JOINERS = "\u200c\u200d"  # the only format characters that names need
_XMP_TEXT = rb"""tiff:%b\s*(?:=\s*"([^"<]*)"|=\s*'([^'<]*)'|>([^<]*)<)"""

WANTED = frozenset(
    {*TEXTS.values(), *NUMBERS.values(), *GpsTag, Tag.LENS_MODEL, Tag.ORIENTATION, Tag.ISO_SPEED_RATINGS, Tag.ISO_SPEED}
    | {Tag.DATE_TIME, Tag.DATE_TIME_ORIGINAL, Tag.SUB_SEC_TIME, Tag.SUB_SEC_TIME_ORIGINAL, Tag.OFFSET_TIME}
    | {Tag.OFFSET_TIME_ORIGINAL, Tag.XMP, Tag.UNIQUE_CAMERA_MODEL}
)
"""The tags that `metadata_from` looks at."""


def read_metadata(file: IO[bytes]) -> CaptureMetadata:
    """The capture metadata in a TIFF structure; nothing is known of any other file."""
    return metadata_from(read_directories(file, WANTED))


def metadata_from(stored: StoredDirectories) -> CaptureMetadata:
    """The capture metadata in the fields of a file; read with `WANTED` or more."""
    # TIFF/EP, and so DNG, has Exif's fields in the first directory too.
    main, exif = stored.main, {**stored.main, **stored.exif}
    iso, orientation = _number(exif.get(Tag.ISO_SPEED_RATINGS)), _number(main.get(Tag.ORIENTATION))
    if iso == LARGEST_SHORT:
        iso = _number(exif.get(Tag.ISO_SPEED)) or iso
    taken = _time(exif.get(Tag.DATE_TIME_ORIGINAL), exif.get(Tag.SUB_SEC_TIME_ORIGINAL))
    if taken is None:
        taken = _time(main.get(Tag.DATE_TIME), exif.get(Tag.SUB_SEC_TIME))
    found: dict[str, Any] = {
        **{name: text(main.get(tag)) for name, tag in TEXTS.items()},
        **{name: _number(exif.get(tag)) for name, tag in NUMBERS.items()},
        "lens": text(exif.get(Tag.LENS_MODEL)),
        "taken": taken,
        "zone": text(exif.get(Tag.OFFSET_TIME_ORIGINAL)) or text(exif.get(Tag.OFFSET_TIME)),
        "place": _place(stored.gps),
        "altitude": _altitude(stored.gps),
        "iso": None if iso is None else round(iso),
        "orientation": 1 if orientation is None else int(orientation),
    }
    if text(main.get(Tag.UNIQUE_CAMERA_MODEL)).startswith(MAKER):
        # In a DNG of ours the camera is ours, unless somebody has edited it. The source is in the XMP: see `main_directory`.
        ours = (name for name in ("make", "model") if found[name].startswith(MAKER))
        found |= {name: _xmp_text(main.get(Tag.XMP), name.capitalize()) for name in ours}
    metadata = CaptureMetadata()
    for name, value in found.items():
        with suppress(InputError):
            metadata = replace(metadata, **{name: value})
    return metadata


def text(field: StoredField | None) -> str:
    """The printable text of a field of bytes; "" if it has none. Longer texts are cut off at 4096 bytes of UTF-8."""
    if field is None or not isinstance(field.values, bytes):
        return ""
    data = field.values
    if len(data) > 2 * _LONGEST:  # enough, and without half a letter at the end
        data = data[: 2 * _LONGEST].rstrip(_CONTINUATIONS)[:-1]
    # A NUL parts the photographer from the editor in Copyright, and ends every text.
    parts = (part for part in data.split(b"\0") if part.strip())
    return "; ".join(filter(None, (printable(_decoded(part)) for part in parts))).encode()[:_LONGEST].decode(errors="ignore")


def printable(value: str) -> str:
    """The text without what does harm on a terminal or in XML: control, format and private characters, and lone surrogates."""
    kept = ((letter, unicodedata.category(letter)) for letter in value)
    shown = (
        " " if kind in ("Cc", "Zl", "Zp") else letter
        for letter, kind in kept
        if letter in _JOINERS or kind[0] != "C" or kind == "Cc"
    )
    return "".join(shown).strip()


def _decoded(data: bytes) -> str:
    """Exif prescribes ASCII; programs write UTF-8, and old ones what Windows had."""
    for encoding in ("utf-8", "cp1252"):
        with suppress(UnicodeDecodeError):
            return data.decode(encoding)
    return data.decode("latin-1")


def _number(field: StoredField | None) -> float | None:
    """The first number of a field if it is positive and finite."""
    if field is None or isinstance(field.values, bytes):
        return None
    number = field.numbers[0]
    return number if math.isfinite(number) and number > 0 else None


def _time(field: StoredField | None, decimals: StoredField | None) -> datetime | None:
    """Date and time from "YYYY:MM:DD HH:MM:SS" and the decimals of the second; None if it is not one."""
    try:
        taken = datetime.strptime(text(field)[:19], _TIME)  # noqa: DTZ007  Exif has local time without zone
    except ValueError:
        return None
    digits = text(decimals)
    return taken.replace(microsecond=int(f"{digits:0<6}"[:6])) if digits.isdecimal() and digits.isascii() else taken


def _xmp_text(field: StoredField | None, name: str) -> str:
    if field is None or not isinstance(field.values, bytes):
        return ""
    match = re.search(_XMP_TEXT % name.encode(), field.values)
    said = next((group for group in match.groups() if group is not None), b"") if match else b""
    return printable(html.unescape(said.decode(errors="replace")))[:_LONGEST]


def _place(gps: StoredFields) -> tuple[float, float] | None:
    """Return latitude and longitude in degrees; None unless both are whole, for half a position is a wrong one."""
    angles = []
    for tag, letters in ((GpsTag.LATITUDE, "NS"), (GpsTag.LONGITUDE, "EW")):
        reference, stored = text(gps.get(tag - 1)), gps.get(tag)
        if stored is None or stored.kind != FieldType.RATIONAL or len(stored.numbers) != 3 or reference not in tuple(letters):
            return None
        degrees, *parts = stored.numbers
        minutes, seconds = (0 if math.isnan(part) else part for part in parts)  # some write 0/0 for what they do not state
        angle = round(degrees + minutes / 60 + seconds / 3600, 8)  # to a millimetre
        angles.append(-angle if reference == letters[1] else angle)
    return angles[0], angles[1]


def _altitude(gps: StoredFields) -> float | None:
    """Return the metres above the sea; None unless it is clear whether they are above or below."""
    stored, reference = gps.get(GpsTag.ALTITUDE), gps.get(GpsTag.ALTITUDE_REF)
    below = b"\0" if reference is None else reference.values
    if stored is None or stored.kind != FieldType.RATIONAL or below not in (b"\0", b"\1"):
        return None
    return -stored.numbers[0] if below == b"\1" else stored.numbers[0]
