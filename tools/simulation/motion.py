"""A camera that has moved: the light on its sensor, by splines of the fifth order.

They change waves of up to 0.7 of the highest frequency by less than 3 % of a scene between 0 and 2.
"""

import math
from typing import NamedTuple

import numpy as np

from ...shared.arrays import FloatArray

MOST_DEGREES = 30.0
"""The largest rotation that is simulated: beyond it margins would take most of a picture."""
RADIUS = 12
"""Pixels up to which a sample has an influence on interpolated ones that can be measured."""


class Motion(NamedTuple):
    """A motion of the camera.

    Parameters
    ----------
    shift : (float, float)
        Down and across, pixels.
    angle : float
        Radians; positive turns the picture counter-clockwise.

    """

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
    """Return the light on a sensor after a motion: see `offline.burst.in_frame` for where it is.

    Parameters
    ----------
    rgb : float32 (H, W, C)
        The light before it.
    motion : Motion
        Of the camera, pixels of this picture; at most MOST_DEGREES.

    Returns
    -------
    float32 (H, W, C)
        Beyond its borders the outermost pixels go on: it is true `reach` pixels from the border and
        further inside. Interpolation may overshoot at sharp edges, below zero too.

    """
    if motion.none:
        return rgb
    from scipy.ndimage import affine_transform  # takes longer to load than all of ours

    cosine, sine = math.cos(motion.angle), math.sin(motion.angle)
    back = np.array([[cosine, sine], [-sine, cosine]])
    centre = (np.array(rgb.shape[:2]) - 1) / 2
    offset = centre - back @ (centre + motion.shift)
    result = np.empty_like(rgb)
    for channel in range(rgb.shape[2]):
        affine_transform(rgb[..., channel], back, offset, output=result[..., channel], order=5, mode="nearest")
    return result


def reach(motion: Motion, shape: tuple[int, ...]) -> int:
    """Return how far from the border `displaced` depends on what is beyond it, pixels; 0 for no motion."""
    if motion.none:
        return 0
    half = np.array(shape[:2]) / 2
    sine, less = abs(math.sin(motion.angle)), 1 - math.cos(motion.angle)
    moved = half * less + half[::-1] * sine + np.abs(motion.shift)
    return math.ceil(moved.max() + RADIUS)
