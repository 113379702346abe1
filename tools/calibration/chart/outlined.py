"""A quick colour picture of a mosaic, to find a chart in it; it needs no gamma, matrix or white."""

import numpy as np
from scipy.ndimage import convolve, map_coordinates

from ....shared import ByteArray, FloatArray, Mosaic
from ..places import levels_of, listed_defects
from .place import INNER, PATCH, ChartPlace

# pixels: a hole is filled from samples at most this far away; no site of a scattered tile is
# farther from one
_REACH = 2
_WHITE_Q = 0.99  # quantile of a channel that is shown as white


def linear_picture(mosaic: Mosaic) -> FloatArray:
    """Return every channel at every pixel, float32 (H, W, C), in parts of full scale.

    Where luminance was not measured it is the local mean. The chromaticity of a block is the ratio
    of its samples to luminance (gamma is not used), interpolated bilinearly.
    """
    levels, pattern = levels_of(mosaic).copy(), mosaic.pattern
    # A defect gets the level of the next sample of its kind.
    rows, columns = listed_defects(mosaic)
    step = np.where(rows < pattern.period, pattern.period, -pattern.period)
    levels[rows, columns] = levels[np.minimum(rows + step, mosaic.shape[0] - 1), columns]
    luminance = _luminance(mosaic, levels)
    grid = pattern.grid(mosaic.shape)
    rows, columns = grid.whole_rows, grid.whole_columns
    ratios = np.zeros((rows.size, columns.size, len(pattern.channels)), np.float32)
    below = np.zeros_like(ratios)
    for row, column, channel in pattern.sites:
        places = np.ix_(rows + row, columns + column)
        ratios[..., channel] += levels[places]
        below[..., channel] += luminance[places]
    ratios = np.clip(ratios / np.maximum(below, 1e-6), 0, 2)
    if pattern.derived is not None:  # in its place, luminance tells as much
        ratios[..., pattern.derived] = 1
    axes = zip(mosaic.shape, (rows, columns), grid.block_shape, strict=True)
    down, across = (
        (np.arange(size) - origins[0] - (block - 1) / 2) / pattern.period
        for size, origins, block in axes
    )
    places = np.meshgrid(down, across, indexing="ij")
    planes = np.moveaxis(ratios, -1, 0)
    filled = [map_coordinates(plane, places, order=1, mode="nearest") for plane in planes]
    chromaticity = np.stack(filled, axis=-1)
    return (chromaticity * luminance[..., None]).astype(np.float32)


def shown_picture(picture: FloatArray, exponent: float = 2.0, white: float = _WHITE_Q) -> ByteArray:
    """Return a linear picture (H, W, C) as uint8 RGB (H, W, 3), each channel stretched by itself.

    The first, middle and last channel are shown as red, green and blue.

    exponent: of the tone curve. white: quantile of a channel that is shown as white.
    """
    chosen = picture[..., [0, picture.shape[-1] // 2, -1]]
    bright = np.quantile(chosen[::4, ::4].reshape(-1, 3), white, axis=0)
    levels = np.clip(chosen / np.maximum(bright, 1e-6), 0, 1)
    return (255 * levels ** (1 / exponent)).astype(np.uint8)


def overlay(mosaic: Mosaic, place: ChartPlace) -> ByteArray:
    """Return the shot with the chart and the measured part of each patch outlined, uint8 RGB (H, W,
    3).
    """
    from PIL import Image, ImageDraw

    image = Image.fromarray(shown_picture(linear_picture(mosaic)))
    draw, width = ImageDraw.Draw(image), max(1, round(place.pitch / 40))
    quads = (place.patch_corners(PATCH), place.patch_corners(INNER), np.array([place.corners]))
    for outlines, colour in zip(quads, ("white", "magenta", "cyan"), strict=True):
        for quad in outlines:
            draw.polygon(quad.ravel().tolist(), outline=colour, width=width)
    return np.asarray(image)


def _luminance(mosaic: Mosaic, levels: FloatArray) -> FloatArray:
    """Return the panchromatic samples with the holes filled from their neighbours, weighted by
    distance.
    """
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    reach = _REACH if mosaic.pattern.is_scattered else max(_REACH, *mosaic.pattern.block_shape)
    steps = np.arange(-reach, reach + 1)
    kernel = (1.0 / (steps[:, None] ** 2 + steps**2 + 1.0) ** 2).astype(np.float32)
    total = convolve(np.where(measured, levels, np.float32(0)), kernel, mode="mirror")
    weight = convolve(measured.astype(np.float32), kernel, mode="mirror")
    return np.where(measured, levels, total / np.maximum(weight, 1e-6)).astype(np.float32)
