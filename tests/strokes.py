"""Narrow strokes of colour on white, and how much of their colour a picture keeps."""

from functools import lru_cache

import numpy as np

from panchroma.shared.arrays import FloatArray, IndexArray
from panchroma.tools.evaluation.metrics import BORDER

WIDTHS = (8, 12, 16, 24, 36)
"""Pixels across a stroke."""
COLOURS = {"red": (0.5, 0.05, 0.05), "blue": (0.03, 0.05, 0.3), "dark red": (0.12, 0.015, 0.015)}
"""Red, green and blue of the strokes, scene units."""
WHITE = 0.8
"""Every channel of the ground."""
MARGIN = 2
"""Pixels along the edges of a stroke that are left out: there the colour of the ground shines in,
for every method.
"""
_PANEL = 132  # pixels: a whole number of periods of most patterns; three strokes of the widest
_APART = 37.3  # pixels between two strokes
# between the rows and what crosses a stroke: not 45 degrees, so that each meets all places of the
# pattern
_TURN = np.radians(50)


@lru_cache(maxsize=1)
def drawing() -> tuple[FloatArray, IndexArray]:
    """Light of the scene, float32 (H, W, 3), scene units, and where it is measured, (H, W).

    That is inside the strokes the number of their panel, row by row (a row for each of COLOURS, a
    column for each of WIDTHS), else
    -1.
    """
    rows, columns = np.mgrid[:_PANEL, :_PANEL]
    light = np.full((len(COLOURS) * _PANEL, len(WIDTHS) * _PANEL, 3), WHITE, np.float32)
    places = np.full(light.shape[:2], -1, np.intp)
    inner = (np.minimum(rows, columns) >= BORDER) & (np.maximum(rows, columns) < _PANEL - BORDER)
    for row, colour in enumerate(COLOURS.values()):
        for column, width in enumerate(WIDTHS):
            panel = tuple(slice(place * _PANEL, (place + 1) * _PANEL) for place in (row, column))
            across = (rows * np.cos(_TURN) + columns * np.sin(_TURN)) % (width + _APART)
            light[panel][across < width] = colour
            inside = (across >= MARGIN) & (across < width - MARGIN) & inner
            places[panel][inside] = row * len(WIDTHS) + column
    light.flags.writeable = places.flags.writeable = False
    return light, places


def kept(rendered: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Part of the colour that a rendering of the drawing keeps, of each of COLOURS in strokes of
    each of WIDTHS.
    """
    _, places = drawing()
    found = []
    for row, colour in enumerate(COLOURS.values()):
        truth = np.array(colour) - np.mean(colour)
        means = [
            rendered[places == row * len(WIDTHS) + column].mean(axis=0, dtype=np.float64)
            for column in range(len(WIDTHS))
        ]
        found.append(tuple(float(mean @ truth / (truth @ truth)) for mean in means))
    return tuple(found)
