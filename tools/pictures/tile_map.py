"""A picture of the tile that repeats over a sensor: how bright its sites are, and which filter each of them has."""

from collections.abc import Sequence
from io import BytesIO

import numpy as np

from shared.arrays import DoubleArray

_SIDE, _CELL = 480, (56, 120)  # pixels: of the picture, about; of a site, at least and at most
_PAPER, _EDGE, _INK = (255, 255, 255), (24, 24, 27), (24, 24, 27)
_DARKEST, _BRIGHTEST = 20, 235  # levels of grey
_FILTERS = {
    "R": (220, 38, 38),
    "G": (22, 163, 74),
    "B": (37, 99, 235),
    "C": (8, 145, 178),
    "M": (192, 38, 211),
    "Y": (250, 204, 21),
    "W": (255, 255, 255),
}
_OTHER = (161, 161, 170)


def tile_map(tile: Sequence[str], light: DoubleArray) -> bytes:
    """A PNG with a square for each site of a tile, as grey as the site is bright, and in it a disc with the letter of its filter.

    tile: K strings of K letters.
    light: mean level of each site in any unit, (K, K).
    """
    from PIL import Image, ImageDraw, ImageFont

    period = len(tile)
    cell = min(max(_SIDE // period, _CELL[0]), _CELL[1])
    picture = Image.new("RGB", (period * cell + 1, period * cell + 1), _PAPER)
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(cell * 0.36)
    greys = _DARKEST + (light - light.min()) * ((_BRIGHTEST - _DARKEST) / (np.ptp(light) or 1.0))
    for row, column in np.ndindex(period, period):
        left, top, grey = column * cell, row * cell, round(float(greys[row, column]))
        draw.rectangle((left, top, left + cell, top + cell), (grey, grey, grey), _PAPER)
        letter = tile[row][column]
        colour = _FILTERS.get(letter, _OTHER)
        middle = (left + cell / 2, top + cell / 2)
        draw.circle(middle, cell * 0.3, colour, _EDGE)
        ink = _INK if sum(colour) > 450 else _PAPER
        draw.text(middle, letter, ink, font, "mm")
    file = BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()
