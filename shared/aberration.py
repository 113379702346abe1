"""Lateral chromatic aberration: a lens draws each colour at a size of its own.

So every channel's picture is displaced towards the middle of the frame or away from it, most in the corners, and edges have
coloured fringes. A panchromatic sample is the sum of displaced channels.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import CACHED, FloatArray, mirrored, strips
from .errors import InputError
from .figures import tables
from .lens import OfLens, spline_weights

_LARGEST = 0.05
_POLE = 3**0.5 - 2  # of the filter that turns samples into coefficients of a cubic B-spline (Unser 1999, IEEE SPM 16(6), box 2)
_TERMS = 24  # the pole to this power is less than single precision sees


@dataclass(frozen=True)
class Aberration(OfLens):
    """How far the picture of each channel is displaced along the radius of the frame.

    radial: (a, b) of each channel, -0.05 to 0.05: at a pixel that is r away from the middle of the frame, as a share of half the
        diagonal, a channel shows what lies (1 + a + b r^2) times as far away. One channel has (0, 0), to which the others relate.
    size: (rows, columns) of the frames that it was measured on; frames with other sides have to have the same ratio of sides.
    focal_length: of the lens then, millimetres; None = unknown.
    Raises InputError that names the field.

    >>> from shared import Aberration
    >>> red_and_blue = Aberration([[0.001, 0.001], [0, 0], [-0.001, 0]], (800, 1200))
    >>> [round(each, 2) for each in red_and_blue.corner((800, 1200))]
    [1.44, 0.0, -0.72]
    """

    _name, _harm = "chromatic aberration", "fringes may remain, or be made"

    radial: tuple[tuple[float, float], ...]
    size: tuple[int, int]
    focal_length: float | None = None

    def __post_init__(self) -> None:
        pairs = tables("aberration: radial", self.radial, 2)
        if any(len(pair) != 2 for pair in pairs):
            raise InputError("aberration: radial is not a list of [a, b], one for each channel")
        if not all(abs(figure) <= _LARGEST for pair in pairs for figure in pair):  # not for NaN either
            raise InputError(f"aberration: radial holds a figure that is not -{_LARGEST:g} to {_LARGEST:g}: {pairs}")
        if (0.0, 0.0) not in pairs:
            raise InputError(f"aberration: radial is {pairs}, expected one channel with [0, 0], to which the others relate")
        object.__setattr__(self, "radial", pairs)
        self._check_frame()

    def check_channels(self, channels: str) -> None:
        """Raise InputError unless there is one [a, b] for each of these channels (letters)."""
        if len(self.radial) != len(channels):
            raise InputError(f"calibration: aberration has {len(self.radial)} channels, expected {len(channels)} ({channels})")

    def corner(self, shape: tuple[int, int]) -> tuple[float, ...]:
        """How far outside the corners of a frame, (rows, columns), each channel looks there, pixels."""
        return tuple((a + b) * half_diagonal(shape) for a, b in self.radial)

    def words(self, channels: str) -> str:
        """Its size and focal length, for people; channels: their letters.

        >>> from shared import Aberration
        >>> Aberration([[0.001, 0.001], [0, 0], [-0.001, 0]], (800, 1200)).words("RGB")
        'R +1.44, G +0.00, B -0.72 pixels in the corners'
        """
        corners = (f"{channel} {pixels:+.2f}" for channel, pixels in zip(channels, self.corner(self.size), strict=True))
        return f"{', '.join(corners)} pixels in the corners{self.at_focal_length}"

    def reach(self, shape: tuple[int, int]) -> float:
        """The largest displacement of any channel in a frame, (rows, columns), pixels."""
        radius = np.linspace(0, 1, 65)
        return max(float(np.abs(radius * (a + b * radius**2)).max()) for a, b in self.radial) * half_diagonal(shape)

    def displaced(self, rgb: FloatArray) -> FloatArray:
        """What the lens makes of a scene: each channel as it is displaced, by cubic splines; (H, W, C) float32, like the scene."""
        result = rgb.astype(np.float32)
        height, width = result.shape[:2]
        across = np.arange(width) - (width - 1) / 2
        for channel, (a, b) in enumerate(self.radial):
            if a == b == 0:
                continue
            spline = _coefficients(_coefficients(result[..., channel]).T).T
            for rows in strips(height, max(1, CACHED // width)):
                down = np.arange(height)[rows, None] - (height - 1) / 2
                further = a + b * (down**2 + across**2) / half_diagonal((height, width)) ** 2
                places = (down * (1 + further) + (height - 1) / 2, across * (1 + further) + (width - 1) / 2)
                result[rows, :, channel] = _values(spline, *places)
        return result


def half_diagonal(shape: tuple[int, int]) -> float:
    """Half the diagonal of a frame, (rows, columns), from the middle of its first pixel to that of its last, pixels.

    >>> from shared.aberration import half_diagonal
    >>> half_diagonal((31, 41))
    25.0
    """
    return math.hypot(shape[0] - 1, shape[1] - 1) / 2


def _coefficients(plane: FloatArray) -> FloatArray:
    """Coefficients along the columns of the cubic B-spline through a plane that is mirrored at its border."""
    found = np.array(plane, np.float32, order="C")
    first = mirrored(np.arange(_TERMS), len(found))
    found[0] = (_POLE ** np.arange(_TERMS, dtype=np.float32)) @ plane[first]
    for row in range(1, len(found)):
        found[row] += np.float32(_POLE) * found[row - 1]
    found[-1] = np.float32(_POLE / (_POLE**2 - 1)) * (found[-1] + np.float32(_POLE) * found[-2])
    for row in range(len(found) - 2, -1, -1):
        found[row] = np.float32(_POLE) * (found[row + 1] - found[row])
    return np.float32(6) * found


def _values(spline: FloatArray, y: NDArray[np.float64], x: NDArray[np.float64]) -> FloatArray:
    """A spline's values at places, by its coefficients; all (H, W)."""
    total = np.zeros(y.shape, np.float32)
    top, left = (np.floor(place).astype(np.intp) for place in (y, x))
    down, right = (spline_weights((place - first).astype(np.float32)) for place, first in ((y, top), (x, left)))
    columns = [mirrored(left + tap - 1, spline.shape[1]) for tap in range(4)]
    for tap, weight in enumerate(down):
        rows = mirrored(top + tap - 1, spline.shape[0])
        total += weight * sum(right[each] * spline[rows, columns[each]] for each in range(4))
    return total
