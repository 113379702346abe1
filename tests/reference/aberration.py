"""What lateral chromatic aberration changes in samples, pixel by pixel, in float64."""

import numpy as np

from shared import Aberration, CfaPattern
from shared.arrays import DoubleArray
from tests.reference.geometry import keys, letter


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
                seen = keys(picture[..., channel], y0 + (y - y0) * size, x0 + (x - x0) * size)
                kind = letter(pattern, y, x)
                weight = gamma[channel] if kind == "W" else float(kind == pattern.channels[channel])
                more[y, x] += weight * (picture[y, x, channel] - seen)
    return more
