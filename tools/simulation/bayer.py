"""A Bayer sensor, red in the first pixel: the camera of the rivals."""

import numpy as np

from ...shared.arrays import ByteArray, FloatArray

ORDER = "RGGB"
"""Filters of the first two rows."""


def channel_map(shape: tuple[int, ...]) -> ByteArray:
    """The channel that each sample of a mosaic measures, (H, W)."""
    down, across = np.ogrid[: shape[0], : shape[1]]
    return (down % 2 + across % 2).astype(np.uint8)  # 0 1 / 1 2, as in ORDER


def sample_bayer(rgb: FloatArray) -> FloatArray:
    """Samples of a noiseless Bayer sensor, float32 (H, W), from a scene (H, W, 3), both in scene
    units.
    """
    mosaic: FloatArray = np.take_along_axis(rgb, channel_map(rgb.shape)[..., None], axis=2)
    return mosaic[..., 0]
