"""Read capture metadata from the TIFF, Exif and GPS fields of any file. An invalid field counts as missing; it is never an error.

Other programs write and edit these fields, and what they hold goes into every result. So texts lose control characters and length,
and fields that are carried along as they are get the type and the number of values that Exif gives them.
"""

import html
import math
import re
import struct
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import IO, Any

from ..errors import InputError
from ..metadata import CaptureField, CaptureMetadata
from ..tiff import RATIOS, FieldType, number_format, value_bytes
from ..tiff_reading import StoredDirectories, StoredField, read_directories
from .exif import LARGEST_SHORT, NUMBERS, TEXTS, WRITTEN_GPS_VERSION, metadata_directory
from .exif_table import GPS_VERSION, KEPT, REFERENCES, DirectoryName, Kept
from .tags import MAKER, Tag

_TIME = "%Y:%m:%d %H:%M:%S"
# Bytes of a text. All fields together fit into the 64 KiB of a JPEG's Exif block.
_LONGEST, _LONGEST_MORE = 4096, 256
_ASCII_CODE = b"ASCII\0\0\0"  # how Exif marks a text of type UNDEFINED
_CONTINUATIONS = bytes(range(0x80, 0xC0))  # of letters in UTF-8
_JOINERS = "\u200c\u200d"  # the only format characters that names need
_LIMITS = {"NS": 90, "EW": 180}  # degrees
_XMP_TEXT = rb"""tiff:%b\s*(?:=\s*"([^"<]*)"|=\s*'([^'<]*)'|>([^<]*)<)"""

WANTED = frozenset(
    {tag for _, tag in KEPT}
    | {*TEXTS.values(), *NUMBERS.values(), Tag.LENS_MODEL, Tag.LENS_INFO, Tag.ORIENTATION, Tag.DATE_TIME_ORIGINAL}
    | {Tag.ISO_SPEED_RATINGS, Tag.ISO_SPEED, Tag.XMP, Tag.UNIQUE_CAMERA_MODEL}
)
"""The tags that `metadata_from` looks at."""


def read_metadata(file: IO[bytes]) -> CaptureMetadata:
    """The capture metadata in a TIFF structure; nothing is known of any other file."""
    return metadata_from(read_directories(file, WANTED))


def metadata_from(stored: StoredDirectories) -> CaptureMetadata:
    """The capture metadata in the fields of a file; read with `WANTED` or more."""
    stored = replace(
        stored, exif={**stored.main, **stored.exif}
    )  # TIFF/EP, and so DNG, has Exif's fields in the first directory too
    main, exif = stored.main, stored.exif
    iso, orientation = _number(exif.get(Tag.ISO_SPEED_RATINGS)), _number(main.get(Tag.ORIENTATION))
    if iso == LARGEST_SHORT:
        iso = _number(exif.get(Tag.ISO_SPEED)) or iso
    taken = _time(exif.get(Tag.DATE_TIME_ORIGINAL), exif.get(Tag.SUB_SEC_TIME_ORIGINAL))
    if taken is None:  # the time that the decimals belong to is not there
        exif.pop(Tag.SUB_SEC_TIME_ORIGINAL, None)
        taken = _time(main.get(Tag.DATE_TIME), exif.get(Tag.SUB_SEC_TIME))
    found: dict[str, Any] = {
        **{name: text(main.get(tag), _LONGEST) for name, tag in TEXTS.items()},
        **{name: _number(exif.get(tag)) for name, tag in NUMBERS.items()},
        "lens": text(exif.get(Tag.LENS_MODEL), _LONGEST),
        "taken": taken,
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
    return replace(metadata, more=tuple(_more(stored, metadata)))


def text(field: StoredField | None, longest: int = _LONGEST) -> str:
    """The printable text of a field of bytes; "" if it has none. Longer texts are cut off at `longest` bytes of UTF-8."""
    if field is None or not isinstance(field.values, bytes):
        return ""
    data = field.values
    if len(data) > 2 * longest:  # enough, and without half a letter at the end
        data = data[: 2 * longest].rstrip(_CONTINUATIONS)[:-1]
    # A NUL parts the photographer from the editor in Copyright, and ends every text.
    parts = (part for part in data.split(b"\0") if part.strip())
    return "; ".join(filter(None, (printable(_decoded(part)) for part in parts))).encode()[:longest].decode(errors="ignore")


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


def _more(stored: StoredDirectories, named: CaptureMetadata) -> Iterator[CaptureField]:
    """The fields that are carried along, without those that come of what has a name."""
    given = metadata_directory(named)
    written = {("main", tag): value for tag, value in given.fields.items()}
    written |= {("exif", tag): value for tag, value in given.children[Tag.EXIF_IFD].fields.items()}
    written["gps", GPS_VERSION] = FieldType.BYTE, WRITTEN_GPS_VERSION
    for (directory, tag), kept in KEPT.items():
        field = getattr(stored, directory).get(tag)
        if tag == Tag.LENS_SPECIFICATION and field is None:
            field = stored.main.get(Tag.LENS_INFO)
        data = _kept_data(field, kept) if field else b""
        by_name = written.get((directory, tag), ("", ""))[1]
        if (
            data
            and data != (by_name.encode() if isinstance(by_name, str) else by_name)
            and _makes_sense(directory, tag, data, stored)
        ):
            yield CaptureField(directory, tag, kept.kind, data)


def _kept_data(field: StoredField, kept: Kept) -> bytes:
    """The bytes of a field in the type that Exif prescribes; none if its values do not fit."""
    if kept.kind is FieldType.ASCII:
        letters = text(field, _LONGEST_MORE).encode()
        return letters if kept.count in (0, len(letters) + 1) else b""
    if kept.kind is FieldType.UNDEFINED:
        said = StoredField(field.kind, field.values.removeprefix(_ASCII_CODE)) if isinstance(field.values, bytes) else None
        shown = text(said, _LONGEST_MORE)
        return _ASCII_CODE + shown.encode() if shown and shown.isascii() else b""
    if isinstance(field.values, bytes) and field.kind != FieldType.BYTE:
        return b""
    numbers = tuple(field.values)
    if kept.kind in RATIOS and field.kind not in RATIOS:
        numbers = tuple(part for number in numbers for part in (number, 1))
    try:
        data = struct.pack(f"<{len(numbers)}{number_format(kept.kind)}", *numbers)
    except struct.error:  # not whole numbers, or too large ones
        return b""
    return data if len(data) == kept.count * value_bytes(kept.kind) else b""


def _makes_sense(directory: DirectoryName, tag: int, data: bytes, stored: StoredDirectories) -> bool:
    """Whether a field of the GPS directory needs its reference field: half a position is a wrong one."""
    if directory != "gps":
        return True
    if tag == GPS_VERSION:
        return len(stored.gps) > 1
    for number, (reference, letters) in REFERENCES.items():
        if tag in (number, reference):
            mark = stored.gps.get(reference)
            said = _kept_data(mark, KEPT["gps", reference]).decode() if mark else ""
            values = stored.gps.get(number)
            known = (
                values is not None
                and bool(_kept_data(values, KEPT["gps", number]))
                and values.numbers[0] <= _LIMITS.get(letters, math.inf)
            )
            return known and said != "" and said in letters
    if tag == 6 and 5 in stored.gps:  # below the sea, if the reference says so
        return bool(_kept_data(stored.gps[5], KEPT["gps", 5]))
    return True


def shown_fields(metadata: CaptureMetadata) -> dict[str, str | list[float | None]]:
    """The further fields by their names in Exif, for people and JSON: text, or numbers (None = without value)."""
    shown: dict[str, str | list[float | None]] = {}
    for field in metadata.more:
        kept = KEPT[field.directory, field.tag]
        if field.kind in (FieldType.ASCII, FieldType.UNDEFINED):
            shown[kept.name] = field.data.removeprefix(_ASCII_CODE).decode(errors="replace")
            continue
        values = struct.iter_unpack(f"<{number_format(field.kind)}", field.data)
        numbers = StoredField(field.kind, tuple(value for (value,) in values)).numbers
        shown[kept.name] = [number if math.isfinite(number) else None for number in numbers]
    return shown


def place(metadata: CaptureMetadata) -> tuple[float, float] | None:
    """Latitude (north positive) and longitude (east positive) in degrees; None if the metadata do not say."""
    shown = shown_fields(metadata)
    degrees = []
    for name, negative in (("GPSLatitude", "S"), ("GPSLongitude", "W")):
        parts, reference = shown.get(name), str(shown.get(f"{name}Ref"))
        if not isinstance(parts, list) or parts[0] is None:
            return None
        whole = sum((part or 0) / unit for part, unit in zip(parts, (1, 60, 3600), strict=True))
        degrees.append(-whole if reference.startswith(negative) else whole)
    return degrees[0], degrees[1]


def altitude(metadata: CaptureMetadata) -> float | None:
    """Metres above the sea; None if the metadata do not say."""
    shown = shown_fields(metadata)
    height, below = shown.get("GPSAltitude"), shown.get("GPSAltitudeRef") == [1]
    if not isinstance(height, list) or height[0] is None:
        return None
    return -height[0] if below else height[0]
