"""Test charts as functions of position: colour patches, Siemens stars, slanted edges, fine strokes.

Every drawing takes the same parameters and returns linear sRGB reflectances, (h, w, 3), 0.01 to 0.95.

x, y: float64 (h, w), points of a rectangle of height 1, x to the right and y down.
pixel: size of a pixel in these units.
"""

import numpy as np

from shared.arrays import BoolArray, DoubleArray

from .color_checker import draw_patches
from .strokes import ink

CARD, PAPER, INK = 0.035, 0.80, 0.03  # reflectances

# Two colours with the same luminance for this sensor (r + g + b): an edge between them exists only in chromaticity.
WARM, COOL = np.array([0.72, 0.30, 0.12]), np.array([0.12, 0.40, 0.62])
WHITE, BLACK = np.full(3, PAPER), np.full(3, 0.05)
SPOKES = 36
# The lines of letters: top, height, reflectances.
_LINES = (
    (0.565, 0.105, (INK, INK, INK)),
    (0.715, 0.075, (0.50, 0.04, 0.03)),
    (0.830, 0.052, (0.03, 0.06, 0.40)),
    (0.915, 0.034, (INK, INK, INK)),
)
SLANT = np.deg2rad(5.0)  # ISO 12233: near-vertical edges are tilted by 5 degrees


def patches_chart(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Draw the ColorChecker, 6 x 4 patches on black; width 1.5."""
    return draw_patches(x * 4, y * 4, np.array(CARD))


def grey_star(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Draw a Siemens star that varies only in luminance."""
    return _star(x, y, pixel, WHITE, BLACK)


def colour_star(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Draw a Siemens star that varies only in chromaticity."""
    return _star(x, y, pixel, WARM, COOL)


def _star(x: DoubleArray, y: DoubleArray, pixel: float, first: DoubleArray, second: DoubleArray) -> DoubleArray:
    """Draw sinusoidal spokes (ISO 12233, s-SFR: no harmonics that alias), down to the radius where a period is two pixels."""
    right, down = x - 0.5, y - 0.5
    radius = np.hypot(right, down)
    wave = np.sin(SPOKES * np.arctan2(down, right))
    nyquist = SPOKES * 2 * pixel / (2 * np.pi)
    wave[(radius > 0.46) | (radius < nyquist)] = 0
    star: DoubleArray = (first + second) / 2 + wave[..., None] * (first - second) / 2
    return star


def detail_chart(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Draw slanted edges in luminance and in chromaticity, and below them lines of smaller and smaller letters, some in colour."""
    chart = np.full((*x.shape, 3), PAPER)
    for left, ground, square in ((0.0, WHITE, BLACK), (0.5, WARM, COOL)):
        half = (x >= left) & (x < left + 0.5) & (y < 0.5)
        chart[half] = ground
        chart[half & _slanted_square(x - left - 0.25, y - 0.25)] = square
    for top, height, colour in _LINES:
        chart[ink("PANCHROMA", x - 0.06, y - top, height, 0.88)] = colour
    return chart


def _slanted_square(right: DoubleArray, down: DoubleArray) -> BoolArray:
    cosine, sine = np.cos(SLANT), np.sin(SLANT)
    inside: BoolArray = np.maximum(np.abs(right * cosine + down * sine), np.abs(down * cosine - right * sine)) < 0.14
    return inside
