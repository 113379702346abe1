"""Test charts as functions of position: colour patches, Siemens stars, slanted edges, fine strokes.

Every chart is drawn at points (x, y) of a square or rectangle of height 1, x to the right and y down, float64 (h, w); `pixel` is
the size of a pixel in these units. It returns linear sRGB reflectances (h, w, 3), within 0.01 to 0.95.
"""

import numpy as np

from shared.arrays import BoolArray, DoubleArray
from shared.colorimetry import D50, SRGB_TO_XYZ

from .strokes import ink

DARKEST, BRIGHTEST = 0.01, 0.95

# CIE L*a*b* (D50, 2 degrees) of the ColorChecker Classic, in reading order: X-Rite's reference data for charts made after November
# 2014, as colour-science 0.4.7 republishes them ("ColorChecker24 - After November 2014").
COLOR_CHECKER_LAB = (
    (37.54, 14.37, 14.92), (64.66, 19.27, 17.50), (49.32, -3.82, -22.54), (43.46, -12.74, 22.72),
    (54.94, 9.61, -24.79), (70.48, -32.26, -0.37), (62.73, 35.83, 56.50), (39.43, 10.75, -45.17),
    (50.57, 48.64, 16.67), (30.10, 22.54, -20.87), (71.77, -24.13, 58.19), (71.51, 18.24, 67.37),
    (28.37, 15.42, -49.80), (54.38, -39.72, 32.27), (42.43, 51.05, 28.62), (81.80, 2.67, 80.41),
    (50.63, 51.28, -14.12), (49.57, -29.71, -28.32), (95.19, -1.03, 2.93), (81.29, -0.57, 0.44),
    (66.89, -0.75, -0.06), (50.76, -0.13, 0.14), (35.63, -0.46, -0.48), (20.64, 0.07, -0.46),
)  # fmt: skip
PATCH = 0.84  # of the distance between patches
CARD, PAPER, INK = 0.035, 0.80, 0.03  # reflectances

# Two colours alike in luminance as this sensor sees it (r + g + b): an edge between them exists in chromaticity alone.
WARM, COOL = np.array([0.72, 0.30, 0.12]), np.array([0.12, 0.40, 0.62])
WHITE, BLACK = np.full(3, PAPER), np.full(3, 0.05)
SPOKES = 36
# Of the lines of letters: top, height, reflectances.
_LINES = (
    (0.565, 0.105, (INK, INK, INK)),
    (0.715, 0.075, (0.50, 0.04, 0.03)),
    (0.830, 0.052, (0.03, 0.06, 0.40)),
    (0.915, 0.034, (INK, INK, INK)),
)
SLANT = np.deg2rad(5.0)  # ISO 12233: near-vertical edges are tilted by 5 degrees


def color_checker() -> DoubleArray:
    """The 24 patches as linear sRGB, (4, 6, 3); cyan's red and yellow's blue are raised to DARKEST."""
    lightness, a, b = np.array(COLOR_CHECKER_LAB).reshape(4, 6, 3).transpose(2, 0, 1)
    f = (lightness + 16) / 116
    f = np.stack([f + a / 500, f, f - b / 200], axis=-1)
    xyz = np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29)) * D50  # CIE 15, inverse of L*a*b*
    patches: DoubleArray = np.clip(xyz @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T, DARKEST, BRIGHTEST)
    return patches


def patches_chart(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """The ColorChecker, 6 x 4 patches on black; 1.5 wide."""
    column, row = np.clip(x * 4, 0, 5.999), np.clip(y * 4, 0, 3.999)
    inside = (np.abs(column % 1 - 0.5) < PATCH / 2) & (np.abs(row % 1 - 0.5) < PATCH / 2)
    colours = color_checker()[row.astype(int), column.astype(int)]
    chart: DoubleArray = np.where(inside[..., None], colours, CARD)
    return chart


def grey_star(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """A Siemens star in luminance alone."""
    return _star(x, y, pixel, WHITE, BLACK)


def colour_star(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """A Siemens star in chromaticity alone."""
    return _star(x, y, pixel, WARM, COOL)


def _star(x: DoubleArray, y: DoubleArray, pixel: float, first: DoubleArray, second: DoubleArray) -> DoubleArray:
    """Sinusoidal spokes (ISO 12233, s-SFR: no harmonics to alias), down to the radius where a period is two pixels."""
    right, down = x - 0.5, y - 0.5
    radius = np.hypot(right, down)
    wave = np.sin(SPOKES * np.arctan2(down, right))
    nyquist = SPOKES * 2 * pixel / (2 * np.pi)
    wave[(radius > 0.46) | (radius < nyquist)] = 0
    star: DoubleArray = (first + second) / 2 + wave[..., None] * (first - second) / 2
    return star


def detail_chart(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Slanted edges above, in luminance and in chromaticity; lines of ever smaller letters below, some in colour."""
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
