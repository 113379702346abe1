"""Shading: the light of a lens falls off towards the corners, not alike for all filters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...shared import InputError, SensorCalibration, Shading
from ...shared.shading import basis

_POINTS = 9, 11  # control points: the maps are then within 0.03 % of a lens of 2 stops and 15 %
_PLACES = 128  # along an axis, at which they are made, whatever the size of the frame
# after the point: beyond them products of matrices depend on the machine, and equal commands make
# equal files
_DIGITS = 9
_MOST_STOPS, _MOST_PERCENT = 4.0, 50.0


@dataclass(frozen=True)
class Lens:
    """A simulated lens whose corners are darker, and of another colour: see `lens_shading`.

    stops: by which panchromatic pixels get less light there, 0 to 4. percent: 100 times the colour
    shading, 0 to 50.
    """

    stops: float = 0.0
    percent: float = 0.0

    @classmethod
    def of(cls, figures: Sequence[float] | None) -> "Lens":
        """Return the lens with (stops, percent), or stops alone; None is a lens without faults.

        Raises InputError for others.
        """
        if figures is None:
            return cls()
        lens = cls(*map(float, figures[:2]))
        is_known = 0 <= lens.stops <= _MOST_STOPS and 0 <= lens.percent <= _MOST_PERCENT
        if not is_known or not 1 <= len(figures) <= 2:
            limits = f"0 to {_MOST_STOPS:g} stops, 0 to {_MOST_PERCENT:g} %, such as 2,15"
            stated = ",".join(map("{:g}".format, figures))
            raise InputError(f"`shading` is {stated}, expected STOPS,PERCENT: {limits}")
        return lens

    def check(self, known: SensorCalibration, source: object) -> None:
        """Raise InputError, naming the source of a calibration, if that has a shading already."""
        if (self.stops or self.percent) and known.shading is not None:
            raise InputError(f"{source} has its own shading: leave `shading` out")

    def calibrated(
        self, calibration: SensorCalibration, shape: tuple[int, int]
    ) -> SensorCalibration:
        """Return the calibration with the shading of this lens.

        shape: (rows, columns) of the frame.
        """
        if not (self.stops or self.percent):
            return calibration
        shading = lens_shading(self.stops, self.percent / 100, len(calibration.channels) + 1, shape)
        return replace(calibration, shading=shading)


def lens_shading(stops: float, colour: float, planes: int, shape: tuple[int, int]) -> Shading:
    """The shading of a lens whose optical axis meets the middle of the frame.

    Parameters
    ----------
    stops : float
        By which the light of panchromatic pixels has fallen off in the corners. It falls with the
        fourth power of the cosine.
    colour : float
        Share by which the first channel reads less, and the last one more, than panchromatic pixels
        do in the corners; those between lie between.
    planes : int
        Number of channels, and one.
    shape : tuple[int, int]
        (rows, columns) of the frame.

    Examples
    --------
    >>> from panchroma.tools.simulation.lens import lens_shading
    >>> lens = lens_shading(2, 0.15, 4, (600, 900))
    >>> [round(float(lens.of_plane((600, 900), plane)[0, 0]), 2) for plane in range(4)]
    [4.69, 3.99, 3.47, 3.99]
    """
    place = (np.arange(_PLACES) + 0.5) / _PLACES - 0.5
    square = ((shape[0] * place) ** 2)[:, None] + (shape[1] * place) ** 2
    square = square / (shape[0] ** 2 + shape[1] ** 2) * 4
    panchromatic = (1 + (2 ** (stops / 2) - 1) * square) ** 2
    losses = [*np.linspace(colour, -colour, planes - 1), 0.0]
    gains = (panchromatic / (1 - loss * square) for loss in losses)
    # Control points of maps that are known at evenly spaced places.
    even = np.arange(_PLACES, dtype=np.float64)
    down, right = (np.linalg.pinv(basis(_PLACES, count, even)) for count in _POINTS)
    return Shading([(down @ gain @ right.T).round(_DIGITS).tolist() for gain in gains], shape)  # type: ignore[arg-type]
