"""A camera that has moved: where a point of the scene is seen then, and the light on its sensor, by band-limited interpolation.

Rotation is three shears, along rows, columns and rows (Paeth, "A Fast Algorithm for General Raster Rotation", 1986; with one
interpolation per shear: Unser, Thevenaz, Yaroslavsky, "Convolution-based interpolation for fast, high-quality rotation of images",
1995). Each shear shifts whole lines, so every interpolation is along one axis.
"""

import math
from dataclasses import dataclass

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError

MOST_DEGREES = 30.0
"""The largest rotation of `Motion`: beyond it the margins that shears need would take most of a picture."""
RADIUS = 12
"""Pixels on either side from which a value is interpolated: a sinc with Kaiser's window."""
_BETA = 5.5  # Kaiser's parameter; half a pixel changes waves of up to 0.85 of the highest frequency by less than 0.2 %
_LINES = 16  # shifted together, so that they stay in the processor's cache


@dataclass(frozen=True)
class Motion:
    """Where a frame sees what the reference sees at (row, column).

    A point (y, x) of the reference, pixels counted from the centre of the frame, is seen at (y', x') of the frame, counted alike:
        y' = cos(a) y + sin(a) x + down
        x' = cos(a) x - sin(a) y + across
    where a is `degrees`. A positive angle turns the picture clockwise on a screen. The centre of a frame of H rows and W
    columns is at row (H - 1) / 2 and column (W - 1) / 2, counted from 0 at the middle of the first pixel.

    down, across: pixels, from the reference to the frame.
    degrees: rotation about the centre, at most `MOST_DEGREES` either way.
    Raises InputError for a motion that is not finite, and for a larger rotation.

    >>> motion = Motion(down=2, across=-1)
    >>> motion.of(np.array([[10.0, 20.0]]), (101, 101)).tolist()
    [[12.0, 19.0]]
    """

    down: float = 0.0
    across: float = 0.0
    degrees: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.down) and math.isfinite(self.across)):
            raise InputError(f"a motion by {self.down}, {self.across} pixels, expected finite numbers")
        if not abs(self.degrees) <= MOST_DEGREES:
            raise InputError(f"a rotation by {self.degrees} degrees, expected -{MOST_DEGREES:g} to {MOST_DEGREES:g}")

    def of(self, points: DoubleArray, shape: tuple[int, ...]) -> DoubleArray:
        """Where points of the reference are in the frame, (..., 2): row and column, counted from 0.

        points: in the reference, counted alike.
        shape: (rows, columns, ...) of the frame.
        """
        angle = math.radians(self.degrees)
        centre = (np.array(shape[:2]) - 1) / 2
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        found: DoubleArray = (points - centre) @ turn.T + centre + (self.down, self.across)
        return found

    def times(self, factor: float) -> "Motion":
        """The same motion for a frame with `factor` times as many pixels a side."""
        return Motion(self.down * factor, self.across * factor, self.degrees)

    @property
    def none(self) -> bool:
        """Whether nothing has moved."""
        return self.down == self.across == self.degrees == 0


def displaced(rgb: FloatArray, motion: Motion) -> FloatArray:
    """The light on a sensor after a motion, float32 (H, W, C): what was at `p` is at `motion.of(p, shape)`.

    rgb: the light before it, (H, W, C), float32.
    motion: of the camera, pixels of this picture.
    Beyond its borders the outermost pixels go on. The result is true where it does not depend on them: `reach` pixels from the
    border and further inside. Whole pixels of translation are exact. Interpolation may overshoot at sharp edges, below zero too.

    >>> import numpy as np
    >>> light = np.zeros((5, 5, 3), np.float32)
    >>> light[1, 1] = 1
    >>> np.argwhere(displaced(light, Motion(2, 1))[..., 0]).tolist()
    [[3, 2]]
    """
    if motion.none:
        return rgb
    rows, columns = ((np.arange(count) - (count - 1) / 2) for count in rgb.shape[:2])
    along, across = _shears(motion)
    if along:
        rgb = _shifted(rgb, along * rows)
    rgb = _shifted(rgb.swapaxes(0, 1), across * columns + motion.down).swapaxes(0, 1)
    return _shifted(rgb, along * (rows - motion.down) + motion.across)


def reach(motion: Motion, shape: tuple[int, ...]) -> int:
    """Pixels from the border of a picture of this shape up to which `displaced` depends on what is beyond it; 0 for no motion."""
    if motion.none:
        return 0
    along, across = map(abs, _shears(motion))
    rows, columns = shape[:2]
    first = along * rows / 2 + RADIUS if along else 0.0
    last = along * (rows / 2 + abs(motion.down)) + abs(motion.across) + RADIUS
    return math.ceil(max(first + last, across * columns / 2 + abs(motion.down) + RADIUS))


def _shears(motion: Motion) -> tuple[float, float]:
    """Pixels that a row moves to the right per row further down, in the first and the last shear; and a column down per column."""
    angle = math.radians(motion.degrees)
    return -math.tan(angle / 2), math.sin(angle)


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
