"""Letters made of straight strokes: fine detail with corners and ends."""

from itertools import pairwise

import numpy as np

from shared.arrays import BoolArray, DoubleArray

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
