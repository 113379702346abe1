"""What a camera notes beside the samples, carried from the source through the mosaic into every output."""

from dataclasses import dataclass
from datetime import datetime

from .errors import InputError


@dataclass(frozen=True)
class CaptureMetadata:
    """Capture data in Exif 2.3 terms; None or "" where the source does not say.

    taken: local time without zone; exposure_time: seconds; f_number: N of f/N; iso: ISO speed; focal_length: millimetres;
    orientation: TIFF orientation 1..8 of the samples (1 = row 0 is the top), which displays apply and measurements do not.
    """

    make: str = ""
    model: str = ""
    lens: str = ""
    artist: str = ""
    description: str = ""
    taken: datetime | None = None
    exposure_time: float | None = None
    f_number: float | None = None
    iso: int | None = None
    focal_length: float | None = None
    orientation: int = 1

    def __post_init__(self) -> None:
        if self.orientation not in range(1, 9):
            raise InputError(f"metadata: orientation is {self.orientation}, expected 1 to 8")
        for name in ("exposure_time", "f_number", "iso", "focal_length"):
            value = getattr(self, name)
            if value is not None and not 0 < value < 2**31:
                raise InputError(f"metadata: {name} is {value}, expected a positive number")
