"""A camera that has moved: where a point of the scene is seen then, and the light on its sensor, by band-limited interpolation.

Rotation is three shears, along rows, columns and rows (Paeth, "A Fast Algorithm for General Raster Rotation", 1986; with one
interpolation per shear: Unser, Thevenaz, Yaroslavsky, "Convolution-based interpolation for fast, high-quality rotation of images",
1995). Each shear shifts whole lines, so every interpolation is along one axis.
"""

import math
from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray

MOST_DEGREES = 30.0
"""The largest rotation that is simulated: beyond it the margins that shears need would take most of a picture."""
RADIUS = 12
"""Pixels on either side from which a value is interpolated: a sinc with Kaiser's window."""
_BETA = 5.5  # Kaiser's parameter; half a pixel changes waves of up to 0.85 of the highest frequency by less than 0.2 %
_LINES = 16  # shifted together, so that they stay in the processor's cache


class Motion(NamedTuple):
    """A motion of the camera. shift: (down, across), pixels. angle: radians; positive turns the picture counter-clockwise."""

    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    @property
    def none(self) -> bool:
        """True if nothing has moved."""
        return self == Motion()

    def times(self, factor: float) -> "Motion":
        """Return the same motion for a frame with `factor` times as many pixels a side."""
        return Motion((self.shift[0] * factor, self.shift[1] * factor), self.angle)


def displaced(rgb: FloatArray, motion: Motion) -> FloatArray:
    """The light on a sensor after a motion, float32 (H, W, C): what was at a point is where `offline.burst.in_frame` says.

    rgb: the light before it, (H, W, C), float32.
    motion: of the camera, pixels of this picture; at most MOST_DEGREES.
    Beyond its borders the outermost pixels go on. The result is true where it does not depend on them: `reach` pixels from the
    border and further inside. Whole pixels of translation are exact. Interpolation may overshoot at sharp edges, below zero too.

    >>> import numpy as np
    >>> light = np.zeros((5, 5, 3), np.float32)
    >>> light[1, 1] = 1
    >>> np.argwhere(displaced(light, Motion((2, 1)))[..., 0]).tolist()
    [[3, 2]]
    """
    if motion.none:
        return rgb
    rows, columns = ((np.arange(count) - (count - 1) / 2) for count in rgb.shape[:2])
    (down, right), (along, across) = motion.shift, _shears(motion)
    if along:
        rgb = _shifted(rgb, along * rows)
    rgb = _shifted(rgb.swapaxes(0, 1), across * columns + down).swapaxes(0, 1)
    return _shifted(rgb, along * (rows - down) + right)


def reach(motion: Motion, shape: tuple[int, ...]) -> int:
    """Pixels from the border of a picture of this shape up to which `displaced` depends on what is beyond it; 0 for no motion."""
    if motion.none:
        return 0
    (down, right), (along, across) = map(abs, motion.shift), map(abs, _shears(motion))
    rows, columns = shape[:2]
    first = along * rows / 2 + RADIUS if along else 0.0
    last = along * (rows / 2 + down) + right + RADIUS
    return math.ceil(max(first + last, across * columns / 2 + down + RADIUS))


def _shears(motion: Motion) -> tuple[float, float]:
    """Pixels that a row moves to the right per row further down, in the first and the last shear; and a column down per column."""
    return -math.tan(-motion.angle / 2), math.sin(-motion.angle)


def _shifted(rgb: FloatArray, shifts: DoubleArray) -> FloatArray:
    """Move each line (N, C) of a picture (lines, N, C) by its own shift towards higher indices."""
    whole = np.floor(shifts).astype(int)
    taps = np.arange(1 - RADIUS, RADIUS + 1)
    weights = _kernel(taps - (shifts - whole)[:, None])
    border = int(np.abs(whole).max()) + RADIUS
    length = rgb.shape[1]
    moved = np.zeros(rgb.shape, np.float32)
    begins = np.flatnonzero(np.diff(whole, prepend=whole[0] - 1))  # of runs of lines with the same whole part
    for begin, end in zip(begins, [*begins[1:], len(whole)], strict=True):
        for top in range(begin, end, _LINES):
            lines = slice(top, min(top + _LINES, end))
            source = np.pad(rgb[lines], ((0, 0), (border, border), (0, 0)), mode="edge")
            for tap, weight in zip(taps, weights[lines].T, strict=True):
                if weight.any():  # of whole pixels one tap is left
                    start = border - whole[begin] - tap
                    moved[lines] += weight[:, None, None] * source[:, start : start + length]
    return moved


def _kernel(distance: DoubleArray) -> FloatArray:
    """Weights (lines, taps) of the samples at these distances; those of a line add up to 1."""
    window = np.i0(_BETA * np.sqrt(np.maximum(1 - (distance / RADIUS) ** 2, 0)))
    weights = np.sinc(distance) * window
    weights[np.abs(weights) < 1e-12 * window.max()] = 0  # sin(pi) is not quite 0, and whole pixels are to be exact
    weights /= weights.sum(axis=1, keepdims=True)
    return weights.astype(np.float32)
