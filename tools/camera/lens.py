"""The faults of a simulated lens. A new one is a subclass of `LensFault`, and its place in `FAULTS`."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Self

import numpy as np

from shared import Aberration, SensorCalibration, Shading
from shared.aberration import half_diagonal
from shared.arrays import DoubleArray
from shared.errors import InputError
from shared.shading import basis

_POINTS = 9, 11  # control points of shading: the maps are then within 0.03 % of a lens of 2 stops and 15 %
_PLACES = 128  # along an axis, at which they are made, whatever the size of the frame
_DIGITS = 9  # after the point: beyond them products of matrices depend on the machine, and equal commands make equal files
_MOST_STOPS, _MOST_PERCENT = 4.0, 50.0
_MOST_PIXELS, _MOST_SHARE = 20.0, 0.05  # the latter of half the diagonal


@dataclass(frozen=True)
class LensFault(ABC):
    """A fault of a lens whose optical axis meets the middle of the frame. Its fields are figures, checked when made.

    name: as an option, as an argument, and of the calibration's field that describes such a fault.
    metavar, example, help: of that option; the figures have commas between them.
    """

    name: ClassVar[str]
    metavar: ClassVar[str]
    example: ClassVar[str]
    help: ClassVar[str]

    @classmethod
    def of(cls, figures: Sequence[float]) -> Self:
        """The fault with these figures. Raises InputError for another number of them, and for figures out of range."""
        try:
            return cls(*map(float, figures))
        except TypeError:
            cls._refuse(figures, f"{len(fields(cls))} figures")
            raise

    @classmethod
    def _refuse(cls, figures: Sequence[float], expected: str) -> None:
        """Raise InputError that says what was expected instead of these figures."""
        raise InputError(f"`{cls.name}` is {','.join(map('{:g}'.format, figures))}, expected {cls.metavar}: {expected}") from None

    @abstractmethod
    def calibrated(self, calibration: SensorCalibration, shape: tuple[int, int]) -> SensorCalibration:
        """A calibration that describes this fault, too.

        shape: (rows, columns) of the frame.
        Raises InputError if that is too small for it.
        """


@dataclass(frozen=True)
class ShadingFault(LensFault):
    """A lens whose corners are darker, and of another colour: see `lens_shading`.

    stops: by which panchromatic pixels get less light there, 0 to 4.
    percent: 100 times the colour shading, 0 to 50.
    Raises InputError for other figures.
    """

    stops: float
    percent: float = 0.0

    name = "shading"
    metavar = "STOPS,PERCENT"
    example = "2,15"
    help = "a lens whose corners are STOPS darker, with PERCENT less of the first channel and as much more of the last one"

    def __post_init__(self) -> None:
        if not (0 <= self.stops <= _MOST_STOPS and 0 <= self.percent <= _MOST_PERCENT):
            expected = f"0 to {_MOST_STOPS:g} stops, 0 to {_MOST_PERCENT:g} %, such as {self.example}"
            self._refuse((self.stops, self.percent), expected)

    def calibrated(self, calibration: SensorCalibration, shape: tuple[int, int]) -> SensorCalibration:
        """See `LensFault`."""
        shading = lens_shading(self.stops, self.percent / 100, len(calibration.channels) + 1, shape)
        return replace(calibration, shading=shading)


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

    def calibrated(self, calibration: SensorCalibration, shape: tuple[int, int]) -> SensorCalibration:
        """See `LensFault`."""
        return replace(calibration, aberration=lens_aberration(self.first, self.last, len(calibration.channels), shape))


FAULTS: dict[str, type[LensFault]] = {each.name: each for each in (ShadingFault, AberrationFault)}


def lens_of(figures: Mapping[str, Sequence[float] | None]) -> tuple[LensFault, ...]:
    """The faults that are asked for, in the order of FAULTS.

    figures: those of each fault by its name; None, or zeros alone: without this fault.
    Raises InputError for another number of figures, and for figures out of range.
    """
    return tuple(fault.of(asked) for name, fault in FAULTS.items() if (asked := figures.get(name)) is not None and any(asked))


def check_lens(lens: Iterable[LensFault], known: SensorCalibration, source: object) -> None:
    """Raise InputError, naming the source of a calibration, if that knows a fault of this kind already."""
    for fault in lens:
        if getattr(known, fault.name) is not None:
            raise InputError(f"{source} has its own {fault.name}: leave `{fault.name}` out")


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


def _points(gain: DoubleArray) -> Sequence[Sequence[float]]:
    """Control points of a map that is known at evenly spaced places."""
    place = np.arange(_PLACES, dtype=np.float64)
    down, right = (np.linalg.pinv(basis(_PLACES, count, place)) for count in _POINTS)
    return (down @ gain @ right.T).round(_DIGITS).tolist()


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
