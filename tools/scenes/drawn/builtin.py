"""The built-in scene: fallen leaves and a row of test charts, so that everything can be tried without a photograph."""

from collections.abc import Callable

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import SRGB_TO_XYZ

from ..scene import Scene
from .charts import CARD, colour_star, detail_chart, grey_star, patches_chart
from .color_checker import BRIGHTEST, DARKEST
from .dead_leaves import dead_leaves

SAMPLES = 3  # of a chart, per pixel and axis
ASPECT = 1.5  # the frame the layout is made for; in others the charts keep their shape and the gaps differ
HEIGHT, GAP, BORDER = 0.26, 0.05, 0.011  # of a chart, below it, and around it: of the frame's scale
LEAST_HEIGHT = 24  # pixels: smaller charts would be mush, and leaves are more use
CORNER = 0.02

# From left to right: width (of the height), drawing
CHARTS: tuple[tuple[float, Callable[[DoubleArray, DoubleArray, float], DoubleArray]], ...] = (
    (1.5, patches_chart),
    (1.0, grey_star),
    (1.0, colour_star),
    (1.0, detail_chart),
)


def builtin_scene(width: int, height: int) -> Scene:
    """The test scene at any size from 1 x 1; the same size gives the same pixels. Linear sRGB, values from 0.01 to 0.95.

    Dead leaves (see `dead_leaves`) under a soft light; in front of them, from some 140 x 95 pixels on, a ColorChecker, a Siemens
    star in luminance, one in chromaticity, and slanted edges with lettering (see `charts`).
    """
    scale = min(width / ASPECT, height)
    rgb = dead_leaves(width, height, scale) * _light(width, height)[..., None]
    if HEIGHT * scale >= LEAST_HEIGHT:
        _add_charts(rgb, scale)
    return Scene(np.clip(rgb, DARKEST, BRIGHTEST), f"builtin-{width}x{height}", SRGB_TO_XYZ, (1.0, 1.0, 1.0))


def _light(width: int, height: int) -> FloatArray:
    """Light on the leaves, (height, width): from the upper left, falling off to the lower right."""
    down, right = np.linspace(0, 1, height)[:, None], np.linspace(0, 1, width)[None, :]
    light: FloatArray = (1.25 - 0.55 * (0.5 * right + 0.5 * down) ** 1.2).astype(np.float32)
    return light


def _add_charts(rgb: FloatArray, scale: float) -> None:
    """Lay the charts in a row along the lower border, each with a soft shadow on the leaves."""
    height, width = rgb.shape[:2]
    size = round(HEIGHT * scale)
    widths = [round(size * aspect) for aspect, _ in CHARTS]
    gap = (width - sum(widths)) / (len(CHARTS) + 1)
    top = height - size - round(GAP * scale)
    left = gap
    for (_, draw), across in zip(CHARTS, widths, strict=True):
        _lay(rgb, round(left), top, across, size, scale, draw)
        left += across + gap


def _lay(
    rgb: FloatArray,
    left: int,
    top: int,
    width: int,
    size: int,
    scale: float,
    draw: Callable[[DoubleArray, DoubleArray, float], DoubleArray],
) -> None:
    """Draw one chart with its card at (left, top), antialiased, in place."""
    margin = round(BORDER * scale)
    shadow, reach = 1.6 * margin, 3 * margin
    rows = slice(max(top - reach, 0), min(top + size + 2 * reach, rgb.shape[0]))
    columns = slice(max(left - reach, 0), min(left + width + 2 * reach, rgb.shape[1]))
    x, y = _grid(columns.start, columns.stop, 1) - left, _grid(rows.start, rows.stop, 1) - top
    beyond = _outside(x[None, :] - shadow / 2, y[:, None] - shadow, width, size, 0) / (reach + 1e-9)
    rgb[rows, columns] *= (1 - 0.75 * np.clip(1 - beyond, 0, 1) ** 2).astype(np.float32)[..., None]

    # The card's pixels, each the mean of SAMPLES x SAMPLES points.
    x, y = _grid(-margin, width + margin, SAMPLES), _grid(-margin, size + margin, SAMPLES)
    card = np.full((y.size, x.size, 3), CARD)
    inner = (slice(margin * SAMPLES, (margin + size) * SAMPLES), slice(margin * SAMPLES, (margin + width) * SAMPLES))
    card[inner] = draw(*np.meshgrid(x[inner[1]] / size, y[inner[0]] / size), 1 / size)
    covered = (_outside(x[None, :], y[:, None], width, size, CORNER * scale) < margin).astype(np.float64)
    alpha = _mean(covered[..., None])
    target = rgb[top - margin : top + size + margin, left - margin : left + width + margin]
    target *= (1 - alpha).astype(np.float32)
    target += _mean(card * covered[..., None]).astype(np.float32)


def _grid(start: int, stop: int, samples: int) -> DoubleArray:
    """Centres of the samples of pixels start..stop, in pixels."""
    return start + (np.arange((stop - start) * samples) + 0.5) / samples


def _outside(x: DoubleArray, y: DoubleArray, width: float, height: float, corner: float) -> DoubleArray:
    """Distance from the rectangle (0, 0, width, height) drawn in by `corner`, less `corner`: its level lines have round corners."""
    right = np.maximum(np.maximum(corner - x, x - (width - corner)), 0)
    down = np.maximum(np.maximum(corner - y, y - (height - corner)), 0)
    return np.hypot(right, down) - corner


def _mean(samples: DoubleArray) -> DoubleArray:
    """Mean over SAMPLES x SAMPLES: (h, w, C) of samples -> of pixels."""
    rows, columns = samples.shape[0] // SAMPLES, samples.shape[1] // SAMPLES
    mean: DoubleArray = samples.reshape(rows, SAMPLES, columns, SAMPLES, -1).mean(axis=(1, 3))
    return mean
