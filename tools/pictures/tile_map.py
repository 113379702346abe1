"""Pictures of the tile that repeats over a sensor: which filter each site has, and how bright its sites are."""

from collections.abc import Sequence
from html import escape
from io import BytesIO

import numpy as np

from shared.arrays import DoubleArray
from shared.pattern import PANCHROMATIC

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
_FILLS = {"R": "#d6402c", "G": "#3a9a48", "B": "#3465c9", "C": "#17a5b8", "M": "#c2419b", "Y": "#d9b310", PANCHROMATIC: "#f4f4f1"}
_SQUARE = 12  # SVG units of a site of a drawn tile


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


def tile_picture(tile: Sequence[str]) -> str:
    """Return the SVG element of one tile, K rows of K letters. Filters without a colour of their own name get a hue each."""
    squares, side = "", len(tile) * _SQUARE
    others = sorted(set("".join(tile)) - set(_FILLS))
    for row_, letters in enumerate(tile):
        for column, letter in enumerate(letters):
            fill = _FILLS.get(letter) or f"hsl({360 * others.index(letter) / len(others):.0f} 55% 45%)"
            x, y = column * _SQUARE, row_ * _SQUARE
            squares += f'<rect x="{x}" y="{y}" width="{_SQUARE}" height="{_SQUARE}" fill="{fill}"/>'
            if letter != PANCHROMATIC:
                squares += f'<text x="{x + _SQUARE / 2:g}" y="{y + 0.77 * _SQUARE:g}">{escape(letter)}</text>'
    return f'<svg viewBox="0 0 {side} {side}" role="img" aria-label="{"/".join(tile)}">{squares}</svg>'
