"""Measure how far each tile of two planes lies from where a motion puts it, and how certain that is.

The planes are compared at halved sizes, smooth enough to be compared at places between pixels.
"""

from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.motion import Motion

from ..gaussian import smoothed
from ..kernels.displacement import SUMS, displacement_sums
from .frames import DEVIATIONS

BLUR = 1.2
"""Pixels of a level: standard deviation of the Gaussian that takes away what sampling and filled pixels add to texture. Chosen."""
SPREAD = 4 * np.pi * BLUR**2
"""Pixels whose mean has the variance that white noise has after that blur."""
_SMALLEST = 24  # pixels: the shorter side of the coarsest level, or less than twice as many; chosen
_LARGEST = 1_500_000  # pixels: larger planes are compared at half their size; chosen, for time


class Level(NamedTuple):
    """Both planes, reduced.

    scale: pixels of the frame per pixel of the level, a power of two.
    shape: (H, W) of the frame.
    reference, frame: float32, smoothed; NaN where a sample is clipped.
    """

    scale: int
    shape: tuple[int, int]
    reference: FloatArray
    frame: FloatArray

    def affine(self, motion: Motion) -> tuple[DoubleArray, DoubleArray]:
        """As `Motion.affine`, in pixels of the level."""
        turn, start = motion.affine(self.shape)
        return turn, (start + (turn - np.eye(2)) @ np.full(2, (self.scale - 1) / 2)) / self.scale

    def offsets(self, places: DoubleArray, axis: int) -> DoubleArray:
        """How far rows (axis 0) or columns (axis 1) of the level are from the frame's centre, pixels of the level."""
        return places + ((self.scale - self.shape[axis]) / 2) / self.scale


def levels(reference: FloatArray, frame: FloatArray) -> list[Level]:
    """All levels, the finest first."""
    shape, scale, found = (reference.shape[0], reference.shape[1]), 1, []
    planes = reference, frame
    if reference.size > _LARGEST:
        planes, scale = (_halved(reference), _halved(frame)), 2
    while True:
        found.append(Level(scale, shape, *(np.ascontiguousarray(smoothed(plane, BLUR)) for plane in planes)))
        if min(planes[0].shape) < 2 * _SMALLEST:
            return found
        planes, scale = (_halved(planes[0]), _halved(planes[1])), 2 * scale


def tile_edges(size: int, scale: int, nodes: int) -> IndexArray:
    """Where tiles begin and end along a side of a level: each has the pixels that are nearest to its node.

    size: of the frame, pixels; the nodes are evenly spaced from its first pixel to its last.
    """
    middles = (np.arange(nodes - 1) + 0.5) * ((size - 1) / (nodes - 1))
    return np.array([0, *np.ceil((middles - (scale - 1) / 2) / scale), size // scale]).astype(np.intp)


def _halved(plane: FloatArray) -> FloatArray:
    """Means of 2 x 2 pixels."""
    height, width = (size // 2 * 2 for size in plane.shape)
    rows = plane[:height:2, :width] + plane[1:height:2, :width]
    return np.float32(0.25) * (rows[:, ::2] + rows[:, 1::2])


_STEEPNESS = (1 - np.exp(-1 / BLUR**2)) / 2  # squared gradient of blurred white noise, per variance
_MOST_GAIN = 1e6  # where noise is all that two frames show, gains would grow or fall without end
_LEAST = 1e-6  # fraction of the squares of luminance: differences below it are rounding


class Tiles(NamedTuple):
    """A measurement; (R, C) tiles. Pixels are those of the level.

    rows, columns: of the tiles' middles, from the frame's centre, float64 (R,) and (C,).
    shifts: (R, C, 2), how much farther (down, across) than the motion says the tiles lie.
    information: (R, C, 2, 2), inverse of the shifts' covariance: small where there is no texture, or along an edge, or where the
        two planes differ by more than a shift. The differences that the shift leaves say how much noise there is.
    texture: (R, C), sum of the squares of the reference, less its mean.
    rest: (R, C), sum of the squares of the differences that a shift and an offset leave.
    pixels: (R, C), how many counted.
    light: (R, C), mean luminance of the reference, scene units.
    gain: how many times as bright the frame is as the reference.
    """

    rows: DoubleArray
    columns: DoubleArray
    shifts: DoubleArray
    information: DoubleArray
    texture: DoubleArray
    rest: DoubleArray
    pixels: DoubleArray
    light: DoubleArray
    gain: float


def measure(level: Level, nodes: tuple[int, int], motion: Motion, gain: float, local: DoubleArray | None = None) -> Tiles:
    """Measure how the tiles around (R, C) nodes lie, compared with a motion.

    gain: a guess of how many times as bright the frame is.
    local: (R, C, 2), shifts of the nodes besides the motion's own, pixels of the frame.
    """
    rows, columns = (tile_edges(size, level.scale, count) for size, count in zip(level.shape, nodes, strict=True))
    turn, start = level.affine(motion)
    starts = np.broadcast_to(start, (*nodes, 2)) + (0.0 if local is None else local / level.scale)
    sums = np.empty((*nodes, SUMS))
    (yy, yx), (xy, xx) = turn.tolist()
    displacement_sums(level.reference, level.frame, rows, columns, (yy, yx, xy, xx), starts, gain, sums)
    pixels, gy, gx, gyy, gyx, gxx, e, ye, xe, ee, r, f, rr, _ = np.moveaxis(sums, -1, 0)
    number = np.maximum(pixels, 1)
    crossed = gyx - gy * gx / number
    squares = np.stack([gyy - gy * gy / number, crossed, crossed, gxx - gx * gx / number], axis=-1).reshape(*nodes, 2, 2)
    right = np.stack([ye - gy * e / number, xe - gx * e / number], axis=-1)
    least = _LEAST * rr.sum() / max(pixels.sum(), 1) + np.finfo(np.float32).tiny
    shifts = -np.linalg.solve(squares + least * np.eye(2), right[..., None])[..., 0]
    rest = np.maximum(ee - e * e / number + (right * shifts).sum(axis=-1), 0)
    noise = rest / np.maximum(pixels - 3, 1) + least
    seen = (pixels > 0) & (r > 0)
    brighter = float(np.median(f[seen] / r[seen])) if seen.any() else 1.0
    middles = [level.offsets((each[1:] + each[:-1] - 1) / 2, axis) for axis, each in enumerate((rows, columns))]
    # Half of the differences' noise is the reference's, and makes gradients of its own: by chance as much as this.
    chance = _STEEPNESS / 2 * noise * (pixels + DEVIATIONS * np.sqrt(SPREAD * pixels))
    values, axes = np.linalg.eigh(squares - chance[..., None, None] * np.eye(2))
    information = (axes * (np.maximum(values, 0) / (noise * SPREAD)[..., None])[..., None, :]) @ np.swapaxes(axes, -1, -2)
    texture = rr - r * r / number
    return Tiles(
        middles[0],
        middles[1],
        shifts,
        information,
        texture,
        rest,
        pixels,
        r / number,
        min(max(gain * brighter, 1 / _MOST_GAIN), _MOST_GAIN) if brighter > 0 else gain,
    )


def weighted_median(values: FloatArray | DoubleArray, weights: FloatArray | DoubleArray) -> float:
    """The value that half of the weight lies below. values, weights: (n,), n > 0."""
    return float(np.quantile(values, 0.5, weights=weights, method="inverted_cdf"))
