"""Test charts as functions of position: colour patches, Siemens stars, slanted edges, fine strokes.

Every drawing takes the same parameters and returns reflectances, (h, w, C), 0.01 to 0.95.

x, y: float64 (h, w), points of a rectangle of height 1, x to the right and y down.
pixel: size of a pixel in these units.
paints: what it is drawn with.
"""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BoolArray, DoubleArray

from .color_checker import color_checker, draw_patches
from .strokes import ink

CARD, PAPER, INK = 0.035, 0.80, 0.03  # reflectances

# Two colours with the same luminance for this sensor (r + g + b): an edge between them exists only in chromaticity.
WARM, COOL = np.array([0.72, 0.30, 0.12]), np.array([0.12, 0.40, 0.62])
WHITE, BLACK = np.full(3, PAPER), np.full(3, 0.05)
RED_INK, BLUE_INK = np.array([0.50, 0.04, 0.03]), np.array([0.03, 0.06, 0.40])
SPOKES = 36
_LINES = ((0.565, 0.105), (0.715, 0.075), (0.830, 0.052), (0.915, 0.034))  # of letters: top, height
SLANT = np.deg2rad(5.0)  # ISO 12233: near-vertical edges are tilted by 5 degrees


@dataclass(frozen=True, eq=False)
class Paints:
    """Reflectances in C channels.

    patches: (4, 6, C), of the ColorChecker.
    white, black: (C,), what charts without colour are made of.
    warm, cool: (C,), two colours with the same luminance for this sensor.
    inks: (C,) each, for the lines of letters from top to bottom.
    """

    patches: DoubleArray
    white: DoubleArray
    black: DoubleArray
    warm: DoubleArray
    cool: DoubleArray
    inks: tuple[DoubleArray, ...]


def rgb_paints() -> Paints:
    """Paints in linear sRGB."""
    black_ink = np.full(3, INK)
    return Paints(color_checker(), WHITE, BLACK, WARM, COOL, (black_ink, RED_INK, BLUE_INK, black_ink))


def patches_chart(x: DoubleArray, y: DoubleArray, pixel: float, paints: Paints) -> DoubleArray:
    """Draw the ColorChecker, 6 x 4 patches on black; width 1.5."""
    return draw_patches(x * 4, y * 4, np.array(CARD), paints.patches)


def grey_star(x: DoubleArray, y: DoubleArray, pixel: float, paints: Paints) -> DoubleArray:
    """Draw a Siemens star that varies only in luminance."""
    return _star(x, y, pixel, paints.white, paints.black)


def colour_star(x: DoubleArray, y: DoubleArray, pixel: float, paints: Paints) -> DoubleArray:
    """Draw a Siemens star that varies only in chromaticity."""
    return _star(x, y, pixel, paints.warm, paints.cool)


def _star(x: DoubleArray, y: DoubleArray, pixel: float, first: DoubleArray, second: DoubleArray) -> DoubleArray:
    """Draw sinusoidal spokes (ISO 12233, s-SFR: no harmonics that alias), down to the radius where a period is two pixels."""
    right, down = x - 0.5, y - 0.5
    radius = np.hypot(right, down)
    wave = np.sin(SPOKES * np.arctan2(down, right))
    nyquist = SPOKES * 2 * pixel / (2 * np.pi)
    wave[(radius > 0.46) | (radius < nyquist)] = 0
    return (first + second) / 2 + wave[..., None] * (first - second) / 2


def detail_chart(x: DoubleArray, y: DoubleArray, pixel: float, paints: Paints) -> DoubleArray:
    """Draw slanted edges in luminance and in chromaticity, and below them lines of smaller and smaller letters, some in colour."""
    chart = np.tile(paints.white, (*x.shape, 1))
    for left, ground, square in ((0.0, paints.white, paints.black), (0.5, paints.warm, paints.cool)):
        half = (x >= left) & (x < left + 0.5) & (y < 0.5)
        chart[half] = ground
        chart[half & _slanted_square(x - left - 0.25, y - 0.25)] = square
    for (top, height), colour in zip(_LINES, paints.inks, strict=True):
        chart[ink("PANCHROMA", x - 0.06, y - top, height, 0.88)] = colour
    return chart


def _slanted_square(right: DoubleArray, down: DoubleArray) -> BoolArray:
    cosine, sine = np.cos(SLANT), np.sin(SLANT)
    return np.maximum(np.abs(right * cosine + down * sine), np.abs(down * cosine - right * sine)) < 0.14
