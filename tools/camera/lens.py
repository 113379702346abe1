"""A simulated lens: its light falls off towards the corners, not alike for all filters, and each colour has a size of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared import Aberration, SensorCalibration, Shading
from shared.aberration import half_diagonal
from shared.arrays import DoubleArray
from shared.errors import InputError
from shared.shading import basis

_POINTS = 9, 11  # control points: the maps are then within 0.03 % of a lens of 2 stops and 15 %
_PLACES = 128  # along an axis, at which they are made, whatever the size of the frame
_MOST_STOPS, _MOST_PERCENT = 4.0, 50.0
_MOST_PIXELS, _MOST_SHARE = 20.0, 0.05  # the latter of half the diagonal


@dataclass(frozen=True)
class SimulatedLens:
    """What a simulated lens shall do; None = nothing of it.

    shading: by how much corners are darker, stops, and the share of colour shading (`lens_shading`).
    aberration: displacement of the first and the last channel in the corners, pixels (`lens_aberration`).
    """

    shading: tuple[float, float] | None = None
    aberration: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.shading and not (0 <= self.shading[0] <= _MOST_STOPS and 0 <= self.shading[1] <= _MOST_PERCENT / 100):
            raise InputError(
                f"`shading` is {self.shading[0]:g},{100 * self.shading[1]:g}, expected 0 to {_MOST_STOPS:g} stops and 0 to "
                f"{_MOST_PERCENT:g} %, such as 2,15"
            )
        if self.aberration and not max(map(abs, self.aberration)) <= _MOST_PIXELS:
            raise InputError(
                f"`aberration` is {self.aberration[0]:g},{self.aberration[1]:g}, expected -{_MOST_PIXELS:g} to {_MOST_PIXELS:g} "
                "pixels each, such as 1,-0.5"
            )

    @classmethod
    def asked(cls, shading: Sequence[float] | None, aberration: Sequence[float] | None) -> "SimulatedLens":
        """The lens of two options: (stops, percent) and (pixels, pixels); None and zeros ask for nothing. Raises InputError."""
        stops, percent = _pair("shading", shading)
        first, last = _pair("aberration", aberration)
        return cls((stops, percent / 100) if stops or percent else None, (first, last) if first or last else None)

    def check(self, known: SensorCalibration, source: object) -> None:
        """Raise InputError, naming its source, if a calibration knows a lens already that does what this one shall do."""
        for name in ("shading", "aberration"):
            if getattr(self, name) and getattr(known, name):
                raise InputError(f"{source} has its own {name}: leave `{name}` out")

    def before(self, calibration: SensorCalibration, shape: tuple[int, int]) -> SensorCalibration:
        """A calibration with this lens before it. shape: (rows, columns) of the frame."""
        channels, lens = len(calibration.channels), calibration
        if self.shading:
            lens = replace(lens, shading=lens_shading(*self.shading, channels + 1, shape))
        return replace(lens, aberration=lens_aberration(*self.aberration, channels, shape)) if self.aberration else lens


def _pair(name: str, values: Sequence[float] | None) -> tuple[float, float]:
    if values is None:
        return 0.0, 0.0
    if len(values) != 2:
        raise InputError(f"`{name}` is {values}, expected two numbers")
    return float(values[0]), float(values[1])


NO_LENS = SimulatedLens()
"""A lens that does nothing."""


def lens_shading(stops: float, colour: float, planes: int, shape: tuple[int, int]) -> Shading:
    """The shading of a lens whose optical axis meets the middle of the frame.

    stops: by which the light of panchromatic pixels has fallen off in the corners. It falls with the fourth power of the cosine.
    colour: share by which the first channel reads less, and the last one more, than panchromatic pixels do in the corners; those
        between lie between.
    planes: number of channels, and one.
    shape: (rows, columns) of the frame.

    >>> from tools.camera.lens import lens_shading
    >>> lens = lens_shading(2, 0.15, 4, (600, 900))
    >>> [round(float(lens.of_plane((600, 900), plane)[0, 0]), 2) for plane in range(4)]
    [4.68, 3.99, 3.46, 3.99]
    """
    place = (np.arange(_PLACES) + 0.5) / _PLACES - 0.5
    square = ((shape[0] * place) ** 2)[:, None] + (shape[1] * place) ** 2
    square = square / (shape[0] ** 2 + shape[1] ** 2) * 4
    panchromatic = (1 + (2 ** (stops / 2) - 1) * square) ** 2
    less = [*np.linspace(colour, -colour, planes - 1), 0.0]
    return Shading([_points(panchromatic / (1 - each * square)) for each in less], shape)  # type: ignore[arg-type]


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


def _points(gain: DoubleArray) -> Sequence[Sequence[float]]:
    """Control points of a map that is known at evenly spaced places."""
    place = np.arange(_PLACES, dtype=np.float64)
    down, right = (np.linalg.pinv(basis(_PLACES, count, place)) for count in _POINTS)
    points: list[list[float]] = (down @ gain @ right.T).tolist()
    return points
