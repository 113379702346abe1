"""Test charts as functions of position: the ColorChecker Classic, Siemens stars, slanted edges,
letters made of straight strokes.

Every drawing takes the same parameters and returns reflectances, linear sRGB (h, w, 3), 0.01 to
0.95.

x, y: float64 (h, w), points of a rectangle of height 1, x to the right and y down.
pixel: size of a pixel in these units.
"""

from functools import partial
from itertools import pairwise

import numpy as np

from ....shared.arrays import BoolArray, DoubleArray
from ....shared.colorimetry import SRGB_TO_XYZ
from ...io.colour import lab_to_xyz
from ...io.scene import Scene
from ..perspective import apply_homography, homography, rectangle

CARD, PAPER, INK = 0.035, 0.80, 0.03  # reflectances; CARD is what is around patches

# Two colours with the same luminance for this sensor (r + g + b): an edge between them exists only
# in chromaticity.
WARM, COOL = np.array([0.72, 0.30, 0.12]), np.array([0.12, 0.40, 0.62])
WHITE, BLACK = np.full(3, PAPER), np.full(3, 0.05)
RED_INK, BLUE_INK = np.array([0.50, 0.04, 0.03]), np.array([0.03, 0.06, 0.40])
# of the lines of letters from top to bottom
_INKS = (np.full(3, INK), RED_INK, BLUE_INK, np.full(3, INK))
SPOKES = 36
_LINES = ((0.565, 0.105), (0.715, 0.075), (0.830, 0.052), (0.915, 0.034))  # of letters: top, height
SLANT = np.deg2rad(5.0)  # ISO 12233: near-vertical edges are tilted by 5 degrees

Point = tuple[float, float]

# The paths of the pen for each letter, in a box 4 wide and 6 high, y down; the pen is lifted
# between paths.
_PEN_PATHS: dict[str, tuple[tuple[Point, ...], ...]] = {
    "A": (((0, 6), (2, 0), (4, 6)), ((0.8, 3.8), (3.2, 3.8))),
    "C": (((4, 1), (3, 0), (1, 0), (0, 1), (0, 5), (1, 6), (3, 6), (4, 5)),),
    "H": (((0, 0), (0, 6)), ((4, 0), (4, 6)), ((0, 3), (4, 3))),
    "M": (((0, 6), (0, 0), (2, 3.5), (4, 0), (4, 6)),),
    "N": (((0, 6), (0, 0), (4, 6), (4, 0)),),
    "O": (((1, 0), (3, 0), (4, 1), (4, 5), (3, 6), (1, 6), (0, 5), (0, 1), (1, 0)),),
    "P": (((0, 6), (0, 0), (3, 0), (4, 0.8), (4, 2.4), (3, 3.2), (0, 3.2)),),
    "R": (((0, 6), (0, 0), (3, 0), (4, 0.8), (4, 2.4), (3, 3.2), (0, 3.2)), ((2, 3.2), (4, 6))),
}
# what is written, and the length of the line, in heights of the chart
_WORD, _LINE = "PANCHROMA ", 0.88
_BOX = 6.0  # height of a letter
_ADVANCE = 5.6  # from letter to letter
_PEN = 0.42  # half the stroke's width

DARKEST, BRIGHTEST = 0.01, 0.95  # limits of the reflectances in drawn charts

# CIE L*a*b* (D50, 2 degrees) of the ColorChecker Classic, in reading order: X-Rite's reference data
# for charts made after November 2014, as colour-science 0.4.7 republishes them ("ColorChecker24 -
# After November 2014").
COLOR_CHECKER_LAB = (
    (37.54, 14.37, 14.92), (64.66, 19.27, 17.50), (49.32, -3.82, -22.54), (43.46, -12.74, 22.72),
    (54.94, 9.61, -24.79), (70.48, -32.26, -0.37), (62.73, 35.83, 56.50), (39.43, 10.75, -45.17),
    (50.57, 48.64, 16.67), (30.10, 22.54, -20.87), (71.77, -24.13, 58.19), (71.51, 18.24, 67.37),
    (28.37, 15.42, -49.80), (54.38, -39.72, 32.27), (42.43, 51.05, 28.62), (81.80, 2.67, 80.41),
    (50.63, 51.28, -14.12), (49.57, -29.71, -28.32), (95.19, -1.03, 2.93), (81.29, -0.57, 0.44),
    (66.89, -0.75, -0.06), (50.76, -0.13, 0.14), (35.63, -0.46, -0.48), (20.64, 0.07, -0.46),
)  # fmt: skip
DRAWN_PATCH = 0.84  # side of a patch, in distances between patches

# The scene: a ColorChecker in perspective under uneven light.
SAMPLES = 3  # per pixel and axis
WALL = (0.36, 0.34, 0.31)
# Corners of the 6 x 4 cells, (x, y) in parts of the frame's width and height: seen from the left
# and a little above, tilted.
CORNERS = ((0.10, 0.13), (0.89, 0.07), (0.94, 0.90), (0.05, 0.84))
RIM = 0.25  # card around the patches, in cells
LIGHT = (1.0, 0.62)  # upper left, lower right


def patches_chart(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Draw the ColorChecker, 6 x 4 patches on black; width 1.5."""
    return draw_patches(x * 4, y * 4, np.array(CARD))


def _star(
    x: DoubleArray, y: DoubleArray, pixel: float, first: DoubleArray, second: DoubleArray
) -> DoubleArray:
    """Draw sinusoidal spokes (ISO 12233, s-SFR: no harmonics that alias), down to the radius where
    a period is two pixels.
    """
    right, down = x - 0.5, y - 0.5
    radius = np.hypot(right, down)
    wave = np.sin(SPOKES * np.arctan2(down, right))
    nyquist = SPOKES * 2 * pixel / (2 * np.pi)
    wave[(radius > 0.46) | (radius < nyquist)] = 0
    return (first + second) / 2 + wave[..., None] * (first - second) / 2


grey_star = partial(_star, first=WHITE, second=BLACK)
"""Draws a Siemens star that varies only in luminance."""
colour_star = partial(_star, first=WARM, second=COOL)
"""Draws a Siemens star that varies only in chromaticity."""


def detail_chart(x: DoubleArray, y: DoubleArray, pixel: float) -> DoubleArray:
    """Draw slanted edges in luminance and in chromaticity, and below them lines of smaller and
    smaller letters, some in colour.
    """
    chart = np.tile(WHITE, (*x.shape, 1))
    for left, ground, square in ((0.0, WHITE, BLACK), (0.5, WARM, COOL)):
        half = (x >= left) & (x < left + 0.5) & (y < 0.5)
        chart[half] = ground
        chart[half & _slanted_square(x - left - 0.25, y - 0.25)] = square
    for (top, height), colour in zip(_LINES, _INKS, strict=True):
        chart[ink(x - 0.06, y - top, height)] = colour
    return chart


def _slanted_square(right: DoubleArray, down: DoubleArray) -> BoolArray:
    cosine, sine = np.cos(SLANT), np.sin(SLANT)
    along, across = np.abs(right * cosine + down * sine), np.abs(down * cosine - right * sine)
    return np.maximum(along, across) < 0.14


def ink(x: DoubleArray, y: DoubleArray, height: float) -> BoolArray:
    """Return where there is ink, bool (h, w), if a word is repeated along a line that starts at (0,
    0), as far as letters fit.

    x, y: (h, w), positions on a regular grid. height: height of a letter, in the units of x and y.
    """
    x, y = x * (_BOX / height), y * (_BOX / height)
    inked = np.zeros(x.shape, bool)
    columns, rows = x[0], y[:, 0]
    letters = int((_LINE * _BOX / height + _ADVANCE - 4) / _ADVANCE)
    for place in range(letters // len(_WORD) * len(_WORD) or min(letters, len(_WORD) - 1)):
        letter = _WORD[place % len(_WORD)]
        for path in _PEN_PATHS.get(letter, ()):
            points = [(across + place * _ADVANCE, down) for across, down in path]
            for (x0, y0), (x1, y1) in pairwise(points):
                left, right = np.searchsorted(columns, (min(x0, x1) - _PEN, max(x0, x1) + _PEN))
                top, bottom = np.searchsorted(rows, (min(y0, y1) - _PEN, max(y0, y1) + _PEN))
                box = (slice(top, bottom), slice(left, right))
                inked[box] |= _near(x[box], y[box], (x0, y0), (x1, y1))
    return inked


def _near(x: DoubleArray, y: DoubleArray, start: Point, end: Point) -> BoolArray:
    """Return which points are within half a pen's width of the line from start to end."""
    across, down = end[0] - start[0], end[1] - start[1]
    along = np.clip(((x - start[0]) * across + (y - start[1]) * down) / (across**2 + down**2), 0, 1)
    return np.hypot(x - start[0] - along * across, y - start[1] - along * down) < _PEN


def color_checker_xyz() -> DoubleArray:
    """Return XYZ (D50, white = 1) of the ColorChecker Classic in reading order, (24, 3)."""
    return lab_to_xyz(np.array(COLOR_CHECKER_LAB))


def color_checker() -> DoubleArray:
    """Return the 24 patches in linear sRGB, (4, 6, 3); cyan's red and yellow's blue are raised to
    DARKEST.
    """
    xyz = color_checker_xyz().reshape(4, 6, 3)
    return np.clip(xyz @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T, DARKEST, BRIGHTEST)


def draw_patches(u: DoubleArray, v: DoubleArray, ground: DoubleArray) -> DoubleArray:
    """Draw the patches of `color_checker` over `ground`.

    Parameters
    ----------
    u, v : DoubleArray
        (h, w), positions in cells: the chart covers 0..6 and 0..4, each patch is in the middle of a
        cell.
    ground : DoubleArray
        Broadcasts to (h, w, 3), colours between and around the patches.
    """
    column, row = np.clip(u, 0, 5.999), np.clip(v, 0, 3.999)
    inside = np.maximum(np.abs(column % 1 - 0.5), np.abs(row % 1 - 0.5)) < DRAWN_PATCH / 2
    patches = color_checker()[row.astype(int), column.astype(int)]
    return np.where(inside[..., None], patches, ground)


def chart_scene(width: int, height: int) -> Scene:
    """Draw a ColorChecker at any size from 1 x 1: linear sRGB, the patches of `color_checker` times
    the light.
    """
    to_chart = homography(np.array(CORNERS) * (width, height), rectangle(0, 0, 6, 4))
    rgb = np.zeros((height, width, 3), np.float32)
    for place in np.ndindex(SAMPLES, SAMPLES):
        down, right = (np.array(place) + 0.5) / SAMPLES
        x, y = np.meshgrid(np.arange(width) + right, np.arange(height) + down)
        u, v = apply_homography(to_chart, x, y)
        card = (u > -RIM) & (u < 6 + RIM) & (v > -RIM) & (v < 4 + RIM)
        colours = draw_patches(u, v, np.where(card[..., None], CARD, np.array(WALL)))
        rgb += (colours / SAMPLES**2).astype(np.float32)
    bright, dim = LIGHT
    fall = 0.65 * np.linspace(0, 1, width)[None, :] + 0.35 * np.linspace(0, 1, height)[:, None]
    rgb *= (bright + (dim - bright) * fall**1.5).astype(np.float32)[..., None]
    return Scene(rgb, f"chart-{width}x{height}", SRGB_TO_XYZ, (1.0, 1.0, 1.0))
