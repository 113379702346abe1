"""The built-in scene: fallen leaves and a row of test charts, to try everything without a
photograph.
"""

from collections.abc import Callable

import numpy as np

from ....shared.arrays import DoubleArray, FloatArray
from ....shared.colorimetry import SRGB_TO_XYZ
from ...io.scene import Scene
from .charts import BRIGHTEST, CARD, DARKEST, colour_star, detail_chart, grey_star, patches_chart
from .dead_leaves import STRIP, dead_leaves

SAMPLES = 3  # per pixel and axis of a chart
# width over height of the frame that the layout is made for; in others only the gaps differ
ASPECT = 1.5
# chart, space below it, card around it; parts of the frame's scale
HEIGHT, GAP, BORDER = 0.26, 0.05, 0.011
LEAST_HEIGHT = 24  # pixels: smaller charts would only be mush, so there are none
CORNER = 0.02  # radius of the card's corners, part of the frame's scale

Drawing = Callable[[DoubleArray, DoubleArray, float], DoubleArray]
"""Draws a chart, see `charts`."""

# From left to right, with width over height.
CHARTS: dict[Drawing, float] = {patches_chart: 1.5, grey_star: 1, colour_star: 1, detail_chart: 1}


def builtin_scene(width: int, height: int) -> Scene:
    """Draw the test scene at any size from 1 x 1: linear sRGB, 0.01 to 0.95. The same size gives
    the same pixels.

    It shows dead leaves (see `dead_leaves`) under a soft light. Frames of about 140 x 95 pixels and
    more have charts in front of them: a ColorChecker, a Siemens star in luminance, one in
    chromaticity, and slanted edges with lettering (see `charts`).
    """
    scale = min(width / ASPECT, height)
    picture = dead_leaves(width, height, scale)
    picture *= _light(width, height)[..., None]
    if HEIGHT * scale >= LEAST_HEIGHT:
        _add_charts(picture, scale)
    np.clip(picture, DARKEST, BRIGHTEST, out=picture)
    return Scene(picture, f"builtin-{width}x{height}", SRGB_TO_XYZ, (1.0, 1.0, 1.0))


def _light(width: int, height: int) -> FloatArray:
    """Return the light on the leaves, (height, width): it falls off from the upper left to the
    lower right.
    """
    down, right = np.linspace(0, 1, height)[:, None], np.linspace(0, 1, width)[None, :]
    return (1.25 - 0.55 * (0.5 * right + 0.5 * down) ** 1.2).astype(np.float32)


def _add_charts(picture: FloatArray, scale: float) -> None:
    """Draw the charts into the picture, in a row along the lower border."""
    height, width = picture.shape[:2]
    size = round(HEIGHT * scale)
    widths = [round(size * aspect) for aspect in CHARTS.values()]
    gap = (width - sum(widths)) / (len(CHARTS) + 1)
    top = height - size - round(GAP * scale)
    left = gap
    for draw, across in zip(CHARTS, widths, strict=True):
        _lay(picture, round(left), top, across, size, scale, draw)
        left += across + gap


def _lay(
    rgb: FloatArray, left: int, top: int, width: int, size: int, scale: float, draw: Drawing
) -> None:
    """Draw one chart of width x size pixels into `rgb` at (left, top), antialiased, with its card
    and a soft shadow.
    """
    margin = round(BORDER * scale)
    shadow, reach = 1.6 * margin, 3 * margin
    rows = slice(max(top - reach, 0), min(top + size + 2 * reach, rgb.shape[0]))
    columns = slice(max(left - reach, 0), min(left + width + 2 * reach, rgb.shape[1]))
    x, y = _grid(columns.start, columns.stop, 1) - left, _grid(rows.start, rows.stop, 1) - top
    beyond = _outside(x[None, :] - shadow / 2, y[:, None] - shadow, width, size, 0) / (reach + 1e-9)
    rgb[rows, columns] *= (1 - 0.75 * np.clip(1 - beyond, 0, 1) ** 2).astype(np.float32)[..., None]

    # Each pixel of the card is the mean of SAMPLES x SAMPLES points.
    x, y = _grid(-margin, width + margin, SAMPLES), _grid(-margin, size + margin, SAMPLES)
    for first in range(0, size + 2 * margin, STRIP):
        below = y[first * SAMPLES : (first + STRIP) * SAMPLES]
        inside = ((below > 0) & (below < size))[:, None] & ((x > 0) & (x < width))
        places = np.meshgrid(x / size, below / size)
        card = np.where(inside[..., None], draw(*places, 1 / size), CARD)
        outside = _outside(x[None, :], below[:, None], width, size, CORNER * scale)
        covered = (outside < margin).astype(np.float64)[..., None]
        card *= covered
        up = top - margin + first
        target = rgb[up : up + below.size // SAMPLES, left - margin : left + width + margin]
        target *= (1 - _mean(covered)).astype(np.float32)
        target += _mean(card).astype(np.float32)


def _grid(start: int, stop: int, samples: int) -> DoubleArray:
    """Return the centres of the samples in pixels start..stop, in pixels."""
    return start + (np.arange((stop - start) * samples) + 0.5) / samples


def _outside(
    x: DoubleArray, y: DoubleArray, width: float, height: float, corner: float
) -> DoubleArray:
    """Return the signed distance from the rectangle (0, 0, width, height) with rounded corners of
    radius `corner`.
    """
    right = np.maximum(np.maximum(corner - x, x - (width - corner)), 0)
    down = np.maximum(np.maximum(corner - y, y - (height - corner)), 0)
    return np.hypot(right, down) - corner


def _mean(samples: DoubleArray) -> DoubleArray:
    """Average (h, w, C) over SAMPLES x SAMPLES samples: one value per pixel."""
    rows, columns = samples.shape[0] // SAMPLES, samples.shape[1] // SAMPLES
    return samples.reshape(rows, SAMPLES, columns, SAMPLES, -1).mean(axis=(1, 3))
