"""What lateral chromatic aberration changes in samples, pixel by pixel, in float64."""

import math

import numpy as np

from shared import Aberration, CfaPattern
from shared.arrays import DoubleArray
from tests.reference.geometry import letter


def keys(distance: float) -> float:
    """Cubic convolution (Keys 1981, Eq. 15, a = -1/2)."""
    t = abs(distance)
    if t < 1:
        return 1.5 * t**3 - 2.5 * t**2 + 1
    return -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2 if t < 2 else 0.0


def value(plane: DoubleArray, y: float, x: float) -> float:
    """A plane between its pixels; beyond its edges the nearest pixel counts."""
    total = 0.0
    for row in range(math.floor(y) - 1, math.floor(y) + 3):
        for column in range(math.floor(x) - 1, math.floor(x) + 3):
            pixel = plane[min(max(row, 0), plane.shape[0] - 1), min(max(column, 0), plane.shape[1] - 1)]
            total += keys(y - row) * keys(x - column) * pixel
    return total


def changes(picture: DoubleArray, pattern: CfaPattern, gamma: tuple[float, ...], lens: Aberration) -> DoubleArray:
    """How much more each sample would read without aberration, (H, W). picture: (H, W, C), the scene."""
    height, width, _ = picture.shape
    y0, x0 = (height - 1) / 2, (width - 1) / 2
    more = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            square = ((y - y0) ** 2 + (x - x0) ** 2) / (y0**2 + x0**2)
            for channel, (a, b) in enumerate(lens.radial):
                size = 1 + a + b * square
                seen = value(picture[..., channel], y0 + (y - y0) * size, x0 + (x - x0) * size)
                kind = letter(pattern, y, x)
                weight = gamma[channel] if kind == "W" else float(kind == pattern.channels[channel])
                more[y, x] += weight * (picture[y, x, channel] - seen)
    return more
