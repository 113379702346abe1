"""Lateral chromatic aberration: each colour of a picture has a size of its own."""

from dataclasses import dataclass, replace

import numpy as np

from shared import Aberration, SensorCalibration
from shared.aberration import half_diagonal
from shared.errors import InputError

from .fault import LensFault

_MOST_PIXELS, _MOST_SHARE = 20.0, 0.05  # the latter of half the diagonal


@dataclass(frozen=True)
class AberrationFault(LensFault):
    """A lens with lateral chromatic aberration: see `lens_aberration`.

    first, last: how far outside the corners the first and the last channel look there, -20 to 20 pixels.
    Raises InputError for other figures.
    """

    first: float
    last: float

    name = "aberration"
    metavar = "PIXELS,PIXELS"
    example = "1,-0.5"
    help = (
        "a lens with lateral chromatic aberration: how much further out the first and the last channel look in the corners; "
        "negative is further in"
    )

    def __post_init__(self) -> None:
        if not max(abs(self.first), abs(self.last)) <= _MOST_PIXELS:
            self._refuse((self.first, self.last), f"-{_MOST_PIXELS:g} to {_MOST_PIXELS:g} each, such as {self.example}")

    def is_known(self, calibration: SensorCalibration) -> bool:
        """Whether a calibration has an aberration."""
        return calibration.aberration is not None

    def calibrated(self, calibration: SensorCalibration, shape: tuple[int, int]) -> SensorCalibration:
        """The calibration with this aberration. shape: (rows, columns) of the frame. Raises InputError if that is too small."""
        return replace(calibration, aberration=lens_aberration(self.first, self.last, len(calibration.channels), shape))


def lens_aberration(first: float, last: float, channels: int, shape: tuple[int, int]) -> Aberration:
    """The lateral chromatic aberration of a lens whose optical axis meets the middle of the frame.

    first, last: how far outside the corners the first and the last channel look there, pixels. Half of it grows with the distance
        from the middle, half with its cube. Those between lie between these and 0, which the middle one has.
    channels: number of channels.
    shape: (rows, columns) of the frame.
    Raises InputError when the frame is too small for such displacements.

    >>> from tools.camera.lens import lens_aberration
    >>> [round(each, 2) for each in lens_aberration(1, -0.5, 3, (600, 900)).corner((600, 900))]
    [1.0, 0.0, -0.5]
    """
    half, middle = half_diagonal(shape), channels // 2
    if max(abs(first), abs(last)) > _MOST_SHARE * half:
        raise InputError(
            f"`aberration` is {first:g},{last:g}: the most in a frame of {shape[1]} x {shape[0]} pixels is {_MOST_SHARE * half:.2g}"
        )
    corners = [*np.linspace(first, 0, middle + 1), *np.linspace(0, last, channels - middle)[1:]]
    return Aberration([[each / half / 2] * 2 for each in corners], shape)  # type: ignore[arg-type]
