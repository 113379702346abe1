"""Motion of one frame of a hand-held series against another: a shift, a rotation, and local shifts
(parallax).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Any, NamedTuple

import numpy as np

from ...shared import DoubleArray, FloatArray, InputError
from ..numerics.arrays import Doubles2, Doubles3, Floats2, Floats4
from ..numerics.compile import Chunks, kernel, parallel_kernel
from ..numerics.interpolation import interpolated

# that invert local shifts, which differ by less than 0.1 from pixel to pixel: each divides the
# error by 10 or more
_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class Motion:
    """Place of the points of the reference in another frame of the same size.

    The point (centre + (v, u)), v down and u across, of the reference lies in the other frame at

        centre + shift + (v cos(angle) - u sin(angle), v sin(angle) + u cos(angle)) + local shift

    where centre is ((H - 1) / 2, (W - 1) / 2). `offline.burst.in_frame` and `in_reference` compute
    it and its inverse.

    Attributes
    ----------
    shift : tuple[float, float]
        (down, across), pixels.
    angle : float
        Radians; positive turns the picture counter-clockwise on a screen.
    local : FloatArray | None
        (node rows, node columns, 2), pixels (down, across), two or more nodes along each side;
        None: none. The nodes are a regular grid, the outermost on the outermost pixels of the
        frame; shifts are bilinear between them.

    Raises
    ------
    InputError
        For figures that are not finite, and for another shape of `local`.

    Examples
    --------
    >>> from panchroma.offline.burst import Motion
    >>> turn, start = Motion((2.0, -1.0)).affine((101, 101))
    >>> (turn @ (10, 20) + start).tolist()
    [12.0, 19.0]
    """

    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    local: FloatArray | None = None

    def __post_init__(self) -> None:
        local = np.zeros((2, 2, 2)) if self.local is None else self.local
        is_grid = local.ndim == 3 and min(local.shape[:2]) >= 2 and local.shape[2] == 2
        if not is_grid or not np.isfinite([*self.shift, self.angle, *local.flat]).all():
            shape = None if self.local is None else local.shape
            found = f"a motion of {self.shift} pixels, {self.angle} radians, local shifts {shape}"
            raise InputError(f"{found}: expected finite numbers, shifts (2 or more, 2 or more, 2)")

    def times(self, factor: float) -> "Motion":
        """Return the same motion for a frame with `factor` times as many pixels a side."""
        local = None if self.local is None else self.local * np.float32(factor)
        return Motion((self.shift[0] * factor, self.shift[1] * factor), self.angle, local)

    def affine(self, shape: tuple[int, ...]) -> tuple[DoubleArray, DoubleArray]:
        """(turn (2, 2), start (2,)): without local shifts the pixel p = (row, column) lies at turn
        @ p + start.

        Parameters
        ----------
        shape : tuple[int, ...]
            (H, W).
        """
        turn = np.array([[cos(self.angle), -sin(self.angle)], [sin(self.angle), cos(self.angle)]])
        centre = (np.array(shape) - 1) / 2
        return turn, centre + self.shift - turn @ centre


class Motions(NamedTuple):
    """Motions of F frames for kernels, see `Motion`.

    Attributes
    ----------
    turns : Doubles3
        (F, 2, 2).
    starts : Doubles2
        (F, 2).
    shifts : Floats4
        (F, node rows, node columns, 2), 1 x 1 nodes if there are none.
    spacing : tuple[float, float]
        Nodes per pixel, down and across.
    """

    turns: Doubles3
    starts: Doubles2
    shifts: Floats4
    spacing: tuple[float, float]

    @classmethod
    def of(cls, motions: Sequence[Motion], shape: tuple[int, ...]) -> "Motions":
        """Motions of frames of this shape, whose local shifts have the same nodes."""
        turns, starts = zip(*(motion.affine(shape) for motion in motions), strict=True)
        local = [motion.local for motion in motions]
        nodes = next((grid.shape for grid in local if grid is not None), (1, 1, 2))
        shifts = np.array([np.zeros(nodes) if grid is None else grid for grid in local], np.float32)
        down, across = ((nodes[axis] - 1) / max(shape[axis] - 1, 1) for axis in range(2))
        return cls(np.array(turns), np.array(starts), shifts, (down, across))


@kernel
def frame_place(motions: Motions, frame: int, y: float, x: float) -> tuple[float, float]:
    """Place in a frame of the point (y, x) of the reference."""
    turn, start = motions.turns[frame], motions.starts[frame]
    v, u = _local_shift(motions, frame, y, x)
    down = turn[0, 0] * y + turn[0, 1] * x + start[0] + v
    across = turn[1, 0] * y + turn[1, 1] * x + start[1] + u
    return down, across


@kernel
def reference_place(motions: Motions, frame: int, y: float, x: float) -> tuple[float, float]:
    """Place in the reference of the point (y, x) of a frame: turn^T (point - start - local shift),
    iterated.
    """
    turn = motions.turns[frame]
    down, across = y - motions.starts[frame, 0], x - motions.starts[frame, 1]
    place = turn[0, 0] * down + turn[1, 0] * across, turn[0, 1] * down + turn[1, 1] * across
    for _ in range(_ROUNDS if motions.shifts.shape[1] > 1 else 0):
        local = _local_shift(motions, frame, place[0], place[1])
        v, u = down - local[0], across - local[1]
        place = turn[0, 0] * v + turn[1, 0] * u, turn[0, 1] * v + turn[1, 1] * u
    return place


@kernel
def _local_shift(motions: Motions, frame: int, y: float, x: float) -> tuple[float, float]:
    """Local shift at a point of the reference, bilinear; beyond the outermost nodes it is
    theirs.
    """
    rows, columns = motions.shifts.shape[1], motions.shifts.shape[2]
    if rows < 2:
        return 0.0, 0.0
    y = min(max(y * motions.spacing[0], 0.0), rows - 1.0)
    x = min(max(x * motions.spacing[1], 0.0), columns - 1.0)
    top, left = min(int(y), rows - 2), min(int(x), columns - 2)
    down, across = y - top, x - left
    upper, lower = motions.shifts[frame, top], motions.shifts[frame, top + 1]
    a, b, c, d = (1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across
    v = a * upper[left, 0] + b * upper[left + 1, 0] + c * lower[left, 0] + d * lower[left + 1, 0]
    u = a * upper[left, 1] + b * upper[left + 1, 1] + c * lower[left, 1] + d * lower[left + 1, 1]
    return v, u


@parallel_kernel()
def map_points(
    chunks: Chunks, motions: Motions, points: Doubles2, inverse: int, out: Floats2
) -> None:
    """Write the places in a frame of points (N, 2) of the reference, or with `inverse` the other
    way.

    Parameters
    ----------
    motions : Motions
        One.
    """
    for point in range(chunks[0], chunks[1]):
        y, x = points[point, 0], points[point, 1]
        place = reference_place(motions, 0, y, x) if inverse else frame_place(motions, 0, y, x)
        out[point, 0], out[point, 1] = place


@parallel_kernel()
def displace(chunks: Chunks, plane: Floats2, motions: Motions, out: Floats2) -> None:
    """Write a frame's plane, (H, W), as the reference would see it; NaN where the frame sees
    nothing.

    Parameters
    ----------
    motions : Motions
        One.
    """
    height, width = plane.shape
    for row in range(chunks[0], chunks[1]):
        for column in range(width):
            y, x = frame_place(motions, 0, float(row), float(column))
            inside = -0.5 <= y < height - 0.5 and -0.5 <= x < width - 0.5
            out[row, column] = interpolated(plane, y, x) if inside else np.float32(np.nan)


def in_frame(motion: Motion, y: Any, x: Any, shape: tuple[int, ...]) -> FloatArray:
    """Places (down, across) in a frame of points (y, x) of the reference, pixels; float32
    `(2, *points)`.

    Parameters
    ----------
    y, x : Any
        Arrays of one shape, or that NumPy brings to one.
    shape : tuple[int, ...]
        (H, W) of both frames. Points and places may lie outside.

    Examples
    --------
    >>> from panchroma.offline.burst import Motion, in_frame
    >>> in_frame(Motion((2.0, -1.0)), 10, 20, (101, 101)).tolist()
    [12.0, 19.0]
    """
    return _mapped(motion, y, x, shape, 0)


def in_reference(motion: Motion, y: Any, x: Any, shape: tuple[int, ...]) -> FloatArray:
    """Places in the reference of points of a frame: the inverse of `in_frame`.

    Examples
    --------
    >>> from panchroma.offline.burst import Motion, in_reference
    >>> in_reference(Motion((2.0, -1.0)), 12, 19, (101, 101)).tolist()
    [10.0, 20.0]
    """
    return _mapped(motion, y, x, shape, 1)


def _mapped(motion: Motion, y: Any, x: Any, shape: tuple[int, ...], inverse: int) -> FloatArray:
    points = np.stack(np.broadcast_arrays(y, x), axis=-1).astype(np.float64)
    places = np.empty((points.size // 2, 2), np.float32)
    map_points(Motions.of([motion], shape), points.reshape(-1, 2), inverse, places)
    return np.moveaxis(places.reshape(points.shape), -1, 0)


def displaced(plane: FloatArray, motion: Motion) -> FloatArray:
    """A frame's plane (H, W) as the reference would see it; NaN where the frame sees nothing."""
    result = np.empty(plane.shape, np.float32)
    displace(plane, Motions.of([motion], plane.shape), result)
    return result
