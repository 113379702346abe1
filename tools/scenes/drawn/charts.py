"""Test charts as functions of position: colour patches, Siemens stars, slanted edges, letters made of straight strokes.

Every drawing takes the same parameters and returns reflectances, (h, w, C), 0.01 to 0.95.

x, y: float64 (h, w), points of a rectangle of height 1, x to the right and y down.
pixel: size of a pixel in these units.
paints: what it is drawn with.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from shared.arrays import BoolArray, DoubleArray

from .color_checker import CARD, color_checker, draw_patches

PAPER, INK = 0.80, 0.03  # reflectances

# Two colours with the same luminance for this sensor (r + g + b): an edge between them exists only in chromaticity.
WARM, COOL = np.array([0.72, 0.30, 0.12]), np.array([0.12, 0.40, 0.62])
WHITE, BLACK = np.full(3, PAPER), np.full(3, 0.05)
RED_INK, BLUE_INK = np.array([0.50, 0.04, 0.03]), np.array([0.03, 0.06, 0.40])
SPOKES = 36
_LINES = ((0.565, 0.105), (0.715, 0.075), (0.830, 0.052), (0.915, 0.034))  # of letters: top, height
SLANT = np.deg2rad(5.0)  # ISO 12233: near-vertical edges are tilted by 5 degrees

Point = tuple[float, float]

# The paths of the pen for each letter, in a box 4 wide and 6 high, y down; the pen is lifted between paths.
_LETTERS: dict[str, tuple[tuple[Point, ...], ...]] = {
    "A": (((0, 6), (2, 0), (4, 6)), ((0.8, 3.8), (3.2, 3.8))),
    "C": (((4, 1), (3, 0), (1, 0), (0, 1), (0, 5), (1, 6), (3, 6), (4, 5)),),
    "H": (((0, 0), (0, 6)), ((4, 0), (4, 6)), ((0, 3), (4, 3))),
    "M": (((0, 6), (0, 0), (2, 3.5), (4, 0), (4, 6)),),
    "N": (((0, 6), (0, 0), (4, 6), (4, 0)),),
    "O": (((1, 0), (3, 0), (4, 1), (4, 5), (3, 6), (1, 6), (0, 5), (0, 1), (1, 0)),),
    "P": (((0, 6), (0, 0), (3, 0), (4, 0.8), (4, 2.4), (3, 3.2), (0, 3.2)),),
    "R": (((0, 6), (0, 0), (3, 0), (4, 0.8), (4, 2.4), (3, 3.2), (0, 3.2)), ((2, 3.2), (4, 6))),
}
_BOX = 6.0  # height of a letter
_ADVANCE = 5.6  # from letter to letter
_PEN = 0.42  # half the stroke's width


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


def ink(word: str, x: DoubleArray, y: DoubleArray, height: float, width: float) -> BoolArray:
    """Return where there is ink, bool (h, w), if `word` is repeated along a line that starts at (0, 0).

    word: letters of the alphabet above.
    x, y: (h, w), positions on a regular grid.
    height: height of a letter, in the units of x and y.
    width: length of the line; only letters that fit are drawn.
    """
    x, y = x * (_BOX / height), y * (_BOX / height)
    inked = np.zeros(x.shape, bool)
    columns, rows = x[0], y[:, 0]
    letters = int((width * _BOX / height + _ADVANCE - 4) / _ADVANCE)
    for place in range(letters // (len(word) + 1) * (len(word) + 1) or min(letters, len(word))):
        letter = (word + " ")[place % (len(word) + 1)]
        for path in _LETTERS.get(letter, ()):
            for start, end in pairwise(path):
                (x0, y0), (x1, y1) = (start[0] + place * _ADVANCE, start[1]), (end[0] + place * _ADVANCE, end[1])
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
