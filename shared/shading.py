"""Shading: how much less light lens and sensor collect away from the middle of the frame, for each
filter.

Each plane has a smooth map of the factor that undoes its shading: a cubic B-spline, which needs few
figures. The map is stretched over the frame, so that it also serves frames with fewer, larger
pixels of the same sensor.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import DoubleArray, FloatArray, IndexArray, Pair
from .errors import InputError
from .figures import numbers, shown, size

ZOOMED = 0.02
"""Relative difference of focal lengths from which on they are two."""
_GAINS = (0.05, 64.0)
# Control points beyond the edges, of which little is seen, may be far from the gain.
_LARGEST_GAIN = 1e4
_SKETCH = 129
_POINTS = range(4, 33)  # control points along an axis: a cubic interval takes four


@dataclass(frozen=True)
class Shading:
    """The gain that undoes the shading of each plane, 1 in the middle of the frame.

    Attributes
    ----------
    gain : tuple[tuple[tuple[float, ...], ...], ...]
        Control points of uniform cubic B-splines over the frame: plane (the channels, then
        panchromatic), row, column; 4 to 32 rows and columns. The gain itself is 0.05 to 64.
    size : tuple[int, int]
        (rows, columns) of the frames that it was measured on; other frames have to have the same
        ratio of sides, but for a pixel.
    focal_length : float | None
        Of the lens then, millimetres; None = unknown.
    residual : float
        How far the flat frames are from it, beyond their noise: root mean square, as a share of the
        light.

    Raises
    ------
    InputError
        That names the field.

    Examples
    --------
    >>> from panchroma.shared import Shading
    >>> even = Shading([[[1.0] * 4] * 4] * 4, (800, 1200))
    >>> even.of_plane((800, 1200), 0, slice(0, 2), slice(0, 3)).tolist()
    [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    """

    gain: tuple[tuple[tuple[float, ...], ...], ...]
    size: tuple[int, int]
    focal_length: float | None = None
    residual: float = 0.0

    def __post_init__(self) -> None:
        gain = numbers("shading: gain", self.gain, depth=3)
        try:
            points = np.array(gain, np.float64)
        except ValueError:  # rows of different lengths
            points = np.zeros(0)
        is_grid = points.ndim == 3 and all(count in _POINTS for count in points.shape[1:])
        if not is_grid or np.abs(points).max() > _LARGEST_GAIN:
            grid = f"{_POINTS[0]} to {_POINTS[-1]} rows and columns of control points"
            limits = f"-{_LARGEST_GAIN:g} to {_LARGEST_GAIN:g}"
            raise InputError(f"shading: gain is not a list of planes of {grid} of {limits}")
        object.__setattr__(self, "gain", gain)
        object.__setattr__(self, "size", size("shading: size", self.size))
        focal_length = 0 if self.focal_length is None else self.focal_length
        for name, value in {"residual": self.residual, "focal_length": focal_length}.items():
            if isinstance(value, bool) or not (isinstance(value, int | float) and 0 <= value < 1e6):
                raise InputError(f"shading: {name} is {shown(value)}, expected 0 to a million")
        least, most = self.sketch.min(), self.sketch.max()
        middle = self.sketch[:, _SKETCH // 2, _SKETCH // 2]
        if not _GAINS[0] <= least <= most <= _GAINS[1] or np.abs(middle - 1).max() > 0.01:
            found = f"{least:.3g} to {most:.3g}, and {middle.tolist()} in the middle of the frame"
            expected = f"expected {_GAINS[0]:g} to {_GAINS[1]:g}, and 1"
            raise InputError(f"shading: the gains are {found}, {expected}")

    def check(self, shape: tuple[int, int]) -> None:
        """Raise InputError unless it can be that of frames of this shape, (rows, columns)."""
        # One frame can be the other made smaller if one scale gives both of its sides, but for a
        # fraction of a pixel.
        small, large = sorted((shape, self.size))
        least, most = (np.add(small, step) / large for step in (-1, 1))
        if small != large and least.max() >= most.min():
            measured = f"measured on frames of {self.size[1]} x {self.size[0]} pixels"
            frame = f"the frame has {shape[1]} x {shape[0]}: another area of the sensor"
            remedy = "measure it on such frames, into a camera file of its own"
            raise InputError(f"the shading was {measured}, and {frame}; {remedy}")

    def zoomed(self, focal_length: float | None) -> str:
        """A note on a shot at this focal length, millimetres: "" unless this was measured at
        another one.

        Examples
        --------
        >>> from panchroma.shared import Shading
        >>> Shading([[[1.0] * 4] * 4] * 4, (800, 1200), focal_length=35).zoomed(50)
        'taken at 50 mm, but its shading was measured at 35 mm: colours towards the corners may be
        wrong'
        """
        known = self.focal_length
        if not known or not focal_length or abs(math.log(focal_length / known)) <= ZOOMED:
            return ""
        both = f"taken at {focal_length:g} mm, but its shading was measured at {known:g} mm"
        return f"{both}: colours towards the corners may be wrong"

    def of_plane(
        self, shape: Pair, plane: int = -1, rows: slice = slice(None), columns: slice = slice(None)
    ) -> FloatArray:
        """The gain of a plane in a window of a frame, float32 (rows, columns).

        Parameters
        ----------
        shape : tuple[int, int]
            (rows, columns) of the frame.
        plane : int, optional
            Index of the channel; -1 = panchromatic.
        rows, columns : slice, optional
            The window, also with a step. What a pixel gets does not depend on it.
        """
        points = np.array(self.gain[plane], np.float32)
        # Along the rows first: that is little work. Sums are spelt out, because a product of
        # matrices rounds as its size suggests.
        place, weights = _weights(shape[1], len(points[0]), columns)
        curves = sum(weights[tap] * points[:, place + tap] for tap in range(4))
        place, weights = _weights(shape[0], len(points), rows)
        gain: FloatArray = weights[0][:, None] * curves[place]
        for tap in range(1, 4):
            gain += weights[tap][:, None] * curves[place + tap]
        return gain

    @cached_property
    def sketch(self) -> FloatArray:
        """The gains at a few places, edges and middle among them, float32 (planes, 129, 129)."""
        planes = range(len(self.gain))
        return np.stack([self.of_plane((_SKETCH, _SKETCH), plane) for plane in planes])

    @property
    def stops(self) -> float:
        """The largest fall-off of panchromatic samples."""
        return math.log2(self.sketch[-1].max())

    @property
    def colour(self) -> float:
        """The largest difference between how a colour and panchromatic samples fall off, as a
        share.
        """
        *colours, panchromatic = self.sketch
        return max(float(np.abs(panchromatic / colour - 1).max()) for colour in colours)

    @property
    def words(self) -> str:
        """Its size and focal length, for people.

        Examples
        --------
        >>> from panchroma.shared import Shading
        >>> Shading([[[1.0] * 4] * 4] * 4, (800, 1200), focal_length=35).words
        '0.00 stops, 0.0 % between colours at 35 mm'
        """
        lens = f" at {self.focal_length:g} mm" if self.focal_length else ""
        return f"{self.stops:.2f} stops, {100 * self.colour:.1f} % between colours{lens}"


def basis(length: int, points: int, place: DoubleArray) -> DoubleArray:
    """The weights of all control points at some places, float64 (places, points).

    Parameters
    ----------
    length : int
        Of the frame along this axis, pixels.
    points : int
        Number of control points.
    place : DoubleArray
        Pixels, the middle of the first one is 0.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.shared.shading import basis
    >>> basis(100, 5, np.array([0.0, 49.5, 99.0])).sum(axis=1).round(12).tolist()
    [1.0, 1.0, 1.0]
    """
    first, weights = _control_points((place + 0.5) / length, points)
    full = np.zeros((len(place), points))
    np.put_along_axis(full, first[:, None] + np.arange(4), weights.T, axis=1)
    return full


def _weights(length: int, points: int, span: slice) -> tuple[IndexArray, FloatArray]:
    """For each pixel of a span of an axis the first of its four control points, and their weights,
    float32 (4, pixels).
    """
    first, weights = _control_points((np.arange(length)[span] + 0.5) / length, points)
    return first, weights.astype(np.float32)


def _control_points(place: DoubleArray, points: int) -> tuple[IndexArray, DoubleArray]:
    """For each place, from 0 to 1 across the frame, the first of its four control points, and the
    weights of these in a uniform cubic B-spline, (4, places).
    """
    along = place * (points - 3)
    first = np.clip(along.astype(np.intp), 0, points - 4)
    t = along - first  # from the second control point, 0, to the third, 1
    cubics = (1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3
    return first, np.stack(cubics) / 6
