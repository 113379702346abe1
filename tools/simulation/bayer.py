"""A Bayer sensor, red in the first pixel: the camera of the rivals."""

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import FloatArray

ORDER = "RGGB"
"""Filters of the first two rows."""


def channel_map(shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The channel that each sample of a mosaic measures, (H, W)."""
    numbers = np.broadcast_to(np.arange(3, dtype=np.float32), (*shape, 3))
    return sample_bayer(numbers).astype(np.uint8)


def sample_bayer(rgb: FloatArray) -> FloatArray:
    """Samples of a noiseless Bayer sensor, float32 (H, W), from a scene (H, W, 3), both in scene
    units.
    """
    mosaic: FloatArray = np.empty(rgb.shape[:2], np.float32)
    for place, letter in enumerate(ORDER):
        row, column = divmod(place, 2)
        mosaic[row::2, column::2] = rgb[row::2, column::2, "RGB".index(letter)]
    return mosaic
