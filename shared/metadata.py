"""Capture metadata (Exif), carried from the source through the mosaic into every output."""

import re
from dataclasses import dataclass
from datetime import datetime

from .errors import InputError


@dataclass(frozen=True)
class CaptureMetadata:
    """Capture data as Exif 2.3 defines them; None or "" = unknown.

    Attributes
    ----------
    make, model, lens, artist, copyright, description : str
        Text.
    taken : datetime | None
        Local time;
    zone : str
        Its offset from UTC, as "+05:30".
    exposure_time : float | None
        Seconds.
    f_number : float | None
        N of f/N.
    iso : int | None
        ISO speed.
    focal_length : float | None
        Millimetres.
    orientation : int
        TIFF orientation of the samples, 1 to 8 (1 = row 0 is the top). Displays apply it; the
        samples are never rotated.
    place : tuple[float, float] | None
        Latitude (north positive) and longitude (east positive), degrees;
    altitude : float | None
        Metres above the sea.

    Raises
    ------
    InputError
        For another orientation, zone or place, and for a number that is not positive.

    Examples
    --------
    >>> from panchroma.shared import CaptureMetadata
    >>> metadata = CaptureMetadata(make="Panchroma", exposure_time=1 / 250, f_number=2.8, iso=100)
    >>> metadata.orientation, metadata.lens
    (1, '')
    >>> CaptureMetadata(orientation=9)
    Traceback (most recent call last):
    panchroma.shared.errors.InputError: metadata: orientation is 9, expected 1 to 8
    """

    make: str = ""
    model: str = ""
    lens: str = ""
    artist: str = ""
    copyright: str = ""
    description: str = ""
    taken: datetime | None = None
    zone: str = ""
    exposure_time: float | None = None
    f_number: float | None = None
    iso: int | None = None
    focal_length: float | None = None
    orientation: int = 1
    place: tuple[float, float] | None = None
    altitude: float | None = None

    def __post_init__(self) -> None:
        if self.orientation not in range(1, 9):
            raise InputError(f"metadata: orientation is {self.orientation}, expected 1 to 8")
        if self.zone and not re.fullmatch(r"[+-]\d\d:\d\d", self.zone):
            raise InputError(f"metadata: zone is {self.zone!r}, expected an offset like +05:30")
        if self.place and not (abs(self.place[0]) <= 90 and abs(self.place[1]) <= 180):
            expected = "expected latitude and longitude in degrees"
            raise InputError(f"metadata: place is {self.place}, {expected}")
        if self.altitude is not None and not abs(self.altitude) < 2**31:
            raise InputError(f"metadata: altitude is {self.altitude}, expected metres")
        for name in ("exposure_time", "f_number", "iso", "focal_length"):
            value = getattr(self, name)
            if value is not None and not 0 < value < 2**31:
                raise InputError(f"metadata: {name} is {value}, expected a positive number")
