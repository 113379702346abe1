"""A colour picture of a mosaic for finding a chart in it, made without knowing gamma, matrix or white."""

import numpy as np
from scipy.ndimage import convolve, map_coordinates

from shared import Mosaic
from shared.arrays import ByteArray, FloatArray

_REACH = 2
_SHOWN = 99.0  # percentile of a channel that is shown as white


def linear_picture(mosaic: Mosaic) -> FloatArray:
    """Every channel at every pixel, float32 (H, W, C), in parts of full scale.

    Luminance is the local mean where it was not measured; a block's chromaticity is the plain ratio of its samples to it (the gamma
    of the shot's calibration plays no part), interpolated bilinearly.
    """
    levels = mosaic.signal / np.float32(mosaic.calibration.full_scale)
    luminance = _luminance(mosaic, levels)
    pattern = mosaic.pattern
    grid = pattern.grid(mosaic.shape)
    rows, columns = grid.whole_rows, grid.whole_columns
    ratios = np.zeros((rows.size, columns.size, len(pattern.channels)), np.float32)
    below = np.zeros_like(ratios)
    for row, column, channel in pattern.sites:
        places = np.ix_(rows + row, columns + column)
        ratios[..., channel] += levels[places]
        below[..., channel] += luminance[places]
    ratios = np.clip(ratios / np.maximum(below, 1e-6), 0, 2)
    down, across = (
        (np.arange(size) - origins[0] - (block - 1) / 2) / pattern.period
        for size, origins, block in zip(mosaic.shape, (rows, columns), grid.block_shape, strict=True)
    )
    places = np.meshgrid(down, across, indexing="ij")
    chromaticity = np.stack([map_coordinates(plane, places, order=1, mode="nearest") for plane in np.moveaxis(ratios, -1, 0)], -1)
    picture: FloatArray = (chromaticity * luminance[..., None]).astype(np.float32)
    return picture


def displayed(picture: FloatArray) -> ByteArray:
    """A linear picture (H, W, C) as uint8 (H, W, 3) for a detector of colours: each channel stretched alone, square-root curve.

    The first, the middle and the last channel stand for red, green and blue.
    """
    chosen = picture[..., [0, picture.shape[-1] // 2, -1]]
    bright = np.percentile(chosen[::4, ::4].reshape(-1, 3), _SHOWN, axis=0)
    shown: ByteArray = (255 * np.sqrt(np.clip(chosen / np.maximum(bright, 1e-6), 0, 1))).astype(np.uint8)
    return shown


def _luminance(mosaic: Mosaic, levels: FloatArray) -> FloatArray:
    """Panchromatic samples, the holes filled from those around, nearer ones counting more."""
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    reach = max(_REACH, *mosaic.pattern.block_shape)
    steps = np.arange(-reach, reach + 1)
    kernel = (1.0 / (steps[:, None] ** 2 + steps**2 + 1.0) ** 2).astype(np.float32)
    total = convolve(np.where(measured, levels, np.float32(0)), kernel, mode="mirror")
    weight = convolve(measured.astype(np.float32), kernel, mode="mirror")
    return np.where(measured, levels, total / np.maximum(weight, 1e-6)).astype(np.float32)
