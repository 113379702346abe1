"""Capture metadata (Exif), carried from the source through the mosaic into every output."""

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from .errors import InputError
from .tiff import FieldType


@dataclass(frozen=True)
class CaptureField:
    """A field of Exif that is carried along as it is.

    directory: "main", "exif" or "gps": where it belongs.
    tag: its number.
    kind: its type.
    data: its values as bytes, little-endian; those of a text are UTF-8, without a final NUL.
    """

    directory: Literal["main", "exif", "gps"]
    tag: int
    kind: FieldType
    data: bytes


@dataclass(frozen=True)
class CaptureMetadata:
    """Capture data as Exif 2.3 defines them; None or "" = unknown.

    make, model, lens, artist, copyright, description: text.
    taken: local time without time zone.
    exposure_time: seconds.
    f_number: N of f/N.
    iso: ISO speed.
    focal_length: millimetres.
    orientation: TIFF orientation of the samples, 1 to 8 (1 = row 0 is the top). Displays apply it; the samples are never rotated.
    more: further fields of the source (place, time zone, lens, exposure), none of which one of the names above gives.
    Raises InputError for another orientation, and for a number that is not positive.

    >>> from shared import CaptureMetadata
    >>> metadata = CaptureMetadata(make="Panchroma", exposure_time=1 / 250, f_number=2.8, iso=100)
    >>> metadata.orientation, metadata.lens
    (1, '')
    >>> CaptureMetadata(orientation=9)
    Traceback (most recent call last):
    shared.errors.InputError: metadata: orientation is 9, expected 1 to 8
    """

    make: str = ""
    model: str = ""
    lens: str = ""
    artist: str = ""
    copyright: str = ""
    description: str = ""
    taken: datetime | None = None
    exposure_time: float | None = None
    f_number: float | None = None
    iso: int | None = None
    focal_length: float | None = None
    orientation: int = 1
    more: tuple[CaptureField, ...] = ()

    def __post_init__(self) -> None:
        if self.orientation not in range(1, 9):
            raise InputError(f"metadata: orientation is {self.orientation}, expected 1 to 8")
        for name in ("exposure_time", "f_number", "iso", "focal_length"):
            value = getattr(self, name)
            if value is not None and not 0 < value < 2**31:
                raise InputError(f"metadata: {name} is {value}, expected a positive number")
