"""Capture data in Canon's CRW files (Canon Inc., CIFF Specification on Image Data File, 1.0, revision 4).

rawpy passes on neither make nor model, gives times in the zone of this machine, and aperture and exposure as they were planned.
"""

import struct
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from shared import CaptureMetadata
from shared.dng.exif_reading import text
from shared.dng.tags import Tag
from shared.errors import InputError
from shared.metadata import CaptureField
from shared.tiff import FieldType
from shared.tiff_reading import StoredField

_MARK, _MARK_PLACE = b"HEAPCCDR", 6
_ENTRY_BYTES = 10
_IN_ENTRY, _TYPE, _DIRECTORIES = 0x4000, 0x3800, (0x2800, 0x3000)
_MOST, _DEEPEST, _LONGEST = 256, 4, 4096  # entries of a directory, directories in each other, bytes of a record

_MAKE_AND_MODEL, _OWNER, _TIME, _FOCAL_LENGTH, _SHOT, _SETTINGS = 0x080A, 0x0810, 0x180E, 0x1029, 0x102A, 0x102D
_WANTED = {_MAKE_AND_MODEL, _OWNER, _TIME, _FOCAL_LENGTH, _SHOT, _SETTINGS}
# Indices of numbers in _SHOT and _SETTINGS.
_AUTO_ISO, _BASE_ISO, _PLANNED_APERTURE, _PLANNED_TIME, _APERTURE, _EXPOSURE_TIME = 1, 2, 4, 5, 21, 22
_LONGEST_FOCAL, _SHORTEST_FOCAL, _FOCAL_UNITS = 23, 24, 25


def crw_metadata(path: Path) -> CaptureMetadata:
    """Return the capture data of a CRW; nothing is known of another file. What is damaged counts as missing."""
    with path.open("rb") as file:
        start = file.read(_MARK_PLACE + len(_MARK))
        order = {b"II": "<", b"MM": ">"}.get(start[:2])
        if order is None or start[_MARK_PLACE:] != _MARK:
            return CaptureMetadata()
        found: dict[int, bytes] = {}
        with suppress(struct.error):
            (heap,) = struct.unpack_from(f"{order}I", start, 2)
            _read_directory(file, order, heap, file.seek(0, 2), found, 0)
    return _metadata(found, order)


def _read_directory(file: Any, order: str, start: int, end: int, found: dict[int, bytes], depth: int) -> None:
    """Add the wanted records of the heap from `start` to `end`, and of those in it, to `found`."""
    if depth > _DEEPEST or not 0 <= start < end - 4:
        return
    file.seek(end - 4)
    (table,) = struct.unpack(f"{order}I", file.read(4))
    file.seek(start + table)
    (count,) = struct.unpack(f"{order}H", file.read(2))
    entries = file.read(min(count, _MOST) * _ENTRY_BYTES)
    for place in range(0, len(entries) - _ENTRY_BYTES + 1, _ENTRY_BYTES):
        tag, size, offset = struct.unpack_from(f"{order}HII", entries, place)
        kind = tag & 0x3FFF
        if tag & _IN_ENTRY:
            found.setdefault(kind, entries[place + 2 : place + _ENTRY_BYTES])
        elif kind & _TYPE in _DIRECTORIES and start + offset + size <= end:
            _read_directory(file, order, start + offset, start + offset + size, found, depth + 1)
        elif kind in _WANTED and size <= _LONGEST and start + offset + size <= end:
            file.seek(start + offset)
            found.setdefault(kind, file.read(size))


def _metadata(found: dict[int, bytes], order: str) -> CaptureMetadata:
    make, _, model = found.get(_MAKE_AND_MODEL, b"").partition(b"\0")
    shot, settings, focal = (_numbers(found.get(record, b""), order) for record in (_SHOT, _SETTINGS, _FOCAL_LENGTH))
    units = settings.get(_FOCAL_UNITS, 0)
    metadata = CaptureMetadata(make=_text(make), model=_text(model), artist=_text(found.get(_OWNER, b"")))
    numbers: dict[str, Any] = {
        "f_number": 2 ** (_stops(shot.get(_APERTURE) or shot.get(_PLANNED_APERTURE, 0)) / 2) if shot else None,
        "exposure_time": 2 ** -_stops(shot.get(_EXPOSURE_TIME) or shot.get(_PLANNED_TIME, 0)) if shot else None,
        "iso": round(_iso(shot)) if shot.get(_BASE_ISO) else None,
        "focal_length": focal[1] / units if units and 1 in focal else None,
    }
    for name, number in numbers.items():
        with suppress(InputError):
            metadata = replace(metadata, **{name: number})
    if len(moment := found.get(_TIME, b"")) >= 4:
        seconds = struct.unpack_from(f"{order}I", moment)[0]  # local time, counted as if it were universal
        metadata = replace(metadata, taken=datetime.fromtimestamp(seconds, UTC).replace(tzinfo=None) if seconds else None)
    shortest, longest = settings.get(_SHORTEST_FOCAL, 0), settings.get(_LONGEST_FOCAL, 0)
    if 0 < shortest <= longest and units > 0:
        lens = f"{shortest / units:.1f} - {longest / units:.1f} mm" if shortest < longest else f"{shortest / units:.1f} mm"
        range_of_focal_lengths = struct.pack("<8I", shortest, units, longest, units, 0, 0, 0, 0)
        field = CaptureField("exif", Tag.LENS_SPECIFICATION, FieldType.RATIONAL, range_of_focal_lengths)
        metadata = replace(metadata, lens=lens, more=(field,))
    return metadata


def _text(data: bytes) -> str:
    return text(StoredField(FieldType.ASCII, data.split(b"\0")[0]))


def _numbers(data: bytes, order: str) -> dict[int, int]:
    """The 16-bit numbers of a record by their index."""
    return dict(enumerate(struct.unpack_from(f"{order}{len(data) // 2}h", data)))


def _iso(shot: dict[int, int]) -> float:
    """The automatic and the basic speed are 32nds of stops; no camera has 30 stops."""
    return float(100 / 32 * 2 ** (min(shot[_AUTO_ISO] + shot[_BASE_ISO], 30 * 32) / 32))


def _stops(number: int) -> float:
    """Canon's stops: 32nds, but for thirds, which are 12 and 20."""
    whole, part = divmod(abs(number), 32)
    exact = whole + {12: 1 / 3, 20: 2 / 3}.get(part, part / 32)
    return exact if number >= 0 else -exact
