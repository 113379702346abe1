"""Pictures that explain: how the camera works, how its render compares, and a tile of filters."""

from collections.abc import Sequence
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from shared import Mosaic
from shared.arrays import ByteArray, DoubleArray, FloatArray
from shared.pattern import PANCHROMATIC

from .display import ColourTransform
from .samples import quantise

if TYPE_CHECKING:
    from PIL.Image import Image

_GAP, _PANEL, _CAPTION = 18, 330, 58
_PAPER, _INK, _SOFT = (255, 255, 255), (24, 24, 27), (113, 113, 122)
_FILTERS = {"R": (214, 64, 60), "G": (62, 160, 85), "B": (58, 96, 200), "W": (236, 236, 232)}
_DRAWN = 12  # pixels of a pattern drawing
_SHOWN = 55  # scene pixels across a panel of the overview

# Of a tile.
_SIDE, _CELL = 480, (56, 120)  # pixels: of the picture, about; of a site, at least and at most
_DARKEST, _BRIGHTEST = 20, 235  # levels of grey
_DISCS = {
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

Crop = tuple[int, int]


def overview(mosaic: Mosaic, luminance: FloatArray, rgb: FloatArray, corner: Crop) -> "Image":
    """How the camera works, in six panels: two filter patterns, and a small part of a frame on its way to a picture.

    mosaic: the shot.
    luminance, rgb: its render, denoised: (H, W), (H, W, 3), scene units.
    corner: (row, column) of the first pixel of that part.
    """
    rows, columns = (slice(start, start + _SHOWN) for start in corner)
    shown = ColourTransform.to_space(mosaic.calibration)
    gain = mosaic.calibration.full_scale / float(np.quantile(luminance[rows, columns], 0.98))  # as bright as paper
    scale = gain / mosaic.calibration.full_scale
    grey = np.repeat(mosaic.signal[rows, columns, None] * scale, 3, axis=2)
    planes = mosaic.pattern.filter_map(mosaic.shape)[rows, columns]
    tints = np.array([_FILTERS[letter] for letter in mosaic.pattern.planes], np.float32) / 255
    tints[-1] = 1
    colours = np.where((planes < 3)[..., None], np.sqrt(np.clip(grey * 3, 0, 1)) * tints[planes], 0.1)
    light = np.repeat(luminance[rows, columns, None] * scale, 3, axis=2)
    panels = [
        ("A Bayer sensor", "filters keep out two thirds of the light", _pattern(("RG", "GB"))),
        (
            "The sparse-colour sensor",
            f"{mosaic.pattern.light_efficiency:.1f} times the light, full-resolution luminance",
            _pattern(mosaic.pattern.letters_from()),
        ),
        ("It measures luminance", "nearly everywhere ...", _enlarged(np.sqrt(np.clip(grey, 0, 1)))),
        ("... and colour", f"once in {mosaic.pattern.period} x {mosaic.pattern.period} pixels", _enlarged(colours)),
        ("Luminance, holes filled", "total variation (Eqs. 1-5), then denoised", _enlarged(np.sqrt(np.clip(light, 0, 1)))),
        (
            "Colour, propagated",
            "along the edges of luminance (Eqs. 6-14)",
            _enlarged(shown.apply(rgb[rows, columns] * np.float32(gain))),
        ),
    ]
    return _sheet(panels, across=3)


def comparison(pictures: dict[str, FloatArray], crops: dict[str, Crop], size: int = 66) -> "Image":
    """Crops of the same places side by side: a row per crop, a column per picture.

    pictures: name -> display RGB, (H, W, 3), 0 to 1.
    crops: name -> (row, column) of the first pixel.
    size: rows and columns of a crop, pixels.
    """
    panels = []
    for place, (row, column) in crops.items():
        for name, picture in pictures.items():
            panels.append((name, place, _enlarged(picture[row : row + size, column : column + size])))
    return _sheet(panels, across=len(pictures))


def _pattern(tile: Sequence[str]) -> ByteArray:
    """A drawing of filters, which repeat the letters of `tile`, one cell per pixel."""
    cell = _PANEL // _DRAWN
    picture = np.full((_PANEL, _PANEL, 3), _PAPER, np.uint8)
    margin = (_PANEL - cell * _DRAWN) // 2
    for row, column in np.ndindex(_DRAWN, _DRAWN):
        top, left = margin + row * cell, margin + column * cell
        letter = tile[row % len(tile)][column % len(tile)]
        picture[top : top + cell - 2, left : left + cell - 2] = _FILTERS[letter]
    return picture


def _enlarged(display: FloatArray) -> ByteArray:
    """Pixels as squares, as large as fits a panel."""
    factor = max(1, _PANEL // max(display.shape[:2]))
    return np.kron(quantise(display.astype(np.float32), 8), np.ones((factor, factor, 1), np.uint8)).astype(np.uint8)


def _sheet(panels: list[tuple[str, str, ByteArray]], across: int) -> "Image":
    """Panels on white, each with a title and a line of text below."""
    from PIL import Image, ImageDraw, ImageFont

    down = -(-len(panels) // across)
    width, height = _GAP + across * (_PANEL + _GAP), _GAP + down * (_PANEL + _CAPTION + _GAP)
    sheet = Image.new("RGB", (width, height), _PAPER)
    draw = ImageDraw.Draw(sheet)
    title, line = ImageFont.load_default(19), ImageFont.load_default(15)
    for index, (name, explanation, pixels) in enumerate(panels):
        left = _GAP + index % across * (_PANEL + _GAP)
        top = _GAP + index // across * (_PANEL + _CAPTION + _GAP)
        sheet.paste(Image.fromarray(pixels), (left, top))
        draw.text((left, top + _PANEL + 5), name, _INK, title)
        draw.text((left, top + _PANEL + 30), explanation, _SOFT, line)
    return sheet


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
        colour = _DISCS.get(letter, _OTHER)
        middle = (left + cell / 2, top + cell / 2)
        draw.circle(middle, cell * 0.3, colour, _INK)
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
    return f'<svg viewBox="0 0 {side} {side}" role="img" aria-label="{escape("/".join(tile))}">{squares}</svg>'
