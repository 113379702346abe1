"""Pictures that explain: how the camera works, how its render compares, and a tile of filters."""

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from ...shared import ByteArray, DoubleArray, FloatArray, Mosaic
from ...shared.pattern import PANCHROMATIC
from .display import ColourTransform, quantise

if TYPE_CHECKING:
    from PIL.Image import Image

_GAP, _PANEL, _CAPTION = 18, 330, 58
_PAPER, _INK, _SOFT = (255, 255, 255), (24, 24, 27), (113, 113, 122)
_FILTERS = {
    "R": (214, 64, 60),
    "G": (62, 160, 85),
    "B": (58, 96, 200),
    "C": (23, 165, 184),
    "M": (194, 65, 155),
    "Y": (217, 179, 16),
    PANCHROMATIC: (236, 236, 232),
}
_OTHER = (161, 161, 170)  # of filters with another letter
_DARKEST_GREY, _BRIGHTEST_GREY = 20, 235  # levels of grey of sites
_TILE = 480  # pixels of a drawn tile, about
_DRAWN = 12  # pixels of a pattern drawing
_PANEL_PIXELS = 55  # scene pixels across a panel of the overview

Crop = tuple[int, int]


def overview(mosaic: Mosaic, luminance: FloatArray, rgb: FloatArray, corner: Crop) -> "Image":
    """Draw the working principle of the camera in six panels: two filter patterns, and a small part
    of a frame on its way to a picture.

    Parameters
    ----------
    mosaic : Mosaic
        The shot.
    luminance, rgb : FloatArray
        Its render, denoised: (H, W), (H, W, 3), scene units.
    corner : Crop
        (row, column) of the first pixel of that part.
    """
    rows, columns = (slice(start, start + _PANEL_PIXELS) for start in corner)
    white = float(np.quantile(luminance[rows, columns], 0.98))  # as bright as paper
    both = mosaic.signal, luminance
    signal, filled = (np.repeat(plane[rows, columns, None] / white, 3, axis=2) for plane in both)
    pattern = mosaic.pattern
    planes = pattern.filter_map(mosaic.shape)[rows, columns]
    tints = np.array([_FILTERS[letter] for letter in pattern.planes], np.float32) / 255
    sites = np.sqrt(np.clip(signal * 3, 0, 1)) * tints[planes]
    colours = np.where((planes < 3)[..., None], sites, 0.1)
    measured, denoised = (_enlarged(np.sqrt(np.clip(plane, 0, 1))) for plane in (signal, filled))
    gain = np.float32(mosaic.calibration.full_scale / white)
    coloured = ColourTransform.to_space(mosaic.calibration).apply(rgb[rows, columns] * gain)
    gathered = f"{pattern.light_efficiency():.1f} times the light, full-resolution luminance"
    often = f"once in {pattern.period} x {pattern.period} pixels"
    panels = [
        ("A Bayer sensor", "filters keep out two thirds of the light", _pattern(("RG", "GB"))),
        ("The sparse-colour sensor", gathered, _pattern(pattern.letters_from())),
        ("It measures luminance", "nearly everywhere ...", measured),
        ("... and colour", often, _enlarged(colours)),
        ("Luminance, holes filled", "total variation (Eqs. 1-5), then denoised", denoised),
        ("Colour, propagated", "along the edges of luminance (Eqs. 6-14)", _enlarged(coloured)),
    ]
    return _sheet(panels, across=3)


def comparison(pictures: dict[str, FloatArray], crops: dict[str, Crop], size: int = 66) -> "Image":
    """Crops of the same places side by side: a row per crop, a column per picture.

    Parameters
    ----------
    pictures : dict[str, FloatArray]
        Name -> display RGB, (H, W, 3), 0 to 1.
    crops : dict[str, Crop]
        Name -> (row, column) of the first pixel.
    size : int, optional
        Rows and columns of a crop, pixels.
    """
    panels = []
    for place, (row, column) in crops.items():
        area = np.s_[row : row + size, column : column + size]
        panels += [(name, place, _enlarged(picture[area])) for name, picture in pictures.items()]
    return _sheet(panels, across=len(pictures))


def draw_tile(tile: Sequence[str], side: int, levels: DoubleArray | None = None) -> ByteArray:
    """Return a picture of filters, uint8 (H, W, 3): a square for each, in its colour.

    Parameters
    ----------
    tile : Sequence[str]
        Rows of letters.
    side : int
        Pixels of a square, with a gap of two.
    levels : DoubleArray | None, optional
        Mean level of each site in any unit, (rows, columns): squares as grey as that, with a disc
        in the colour, and a letter.
    """
    from PIL import Image, ImageDraw, ImageFont

    picture = Image.new("RGB", (len(tile[0]) * side, len(tile) * side), _PAPER)
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(side * 0.36)
    greys = None
    if levels is not None:
        step = (_BRIGHTEST_GREY - _DARKEST_GREY) / (np.ptp(levels) or 1.0)
        greys = _DARKEST_GREY + (levels - levels.min()) * step
    for row, column in np.ndindex(len(tile), len(tile[0])):
        letter = tile[row][column]
        left, top, colour = column * side, row * side, _FILTERS.get(letter, _OTHER)
        grey = colour if greys is None else (round(float(greys[row, column])),) * 3
        draw.rectangle((left, top, left + side - 3, top + side - 3), grey)
        if greys is not None:
            middle = (left + side / 2 - 1, top + side / 2 - 1)
            draw.circle(middle, side * 0.3, colour, _INK)
            draw.text(middle, letter, _INK if sum(colour) > 450 else _PAPER, font, "mm")
    return np.asarray(picture)


def tile_map(tile: Sequence[str], levels: DoubleArray) -> bytes:
    """Return the PNG of a tile, K rows of K letters, and of how bright its sites are (K, K): see
    `draw_tile`.
    """
    from PIL import Image

    file = BytesIO()
    Image.fromarray(draw_tile(tile, max(_TILE // len(tile), 56), levels)).save(file, "PNG")
    return file.getvalue()


def _pattern(tile: Sequence[str]) -> ByteArray:
    """A panel with a pattern that repeats `tile`, one square per pixel."""
    rows = [(row * _DRAWN)[:_DRAWN] for row in (list(tile) * _DRAWN)[:_DRAWN]]
    drawn = draw_tile(rows, _PANEL // _DRAWN)
    edges = ((_PANEL - len(drawn)) // 2,) * 2  # what is left over is even
    return np.pad(drawn, (edges, edges, (0, 0)), constant_values=_PAPER[0])


def _enlarged(display: FloatArray) -> ByteArray:
    """Pixels as squares, as large as fits a panel."""
    factor = max(1, _PANEL // max(display.shape[:2]))
    codes = quantise(display.astype(np.float32), 8)
    return codes.repeat(factor, axis=0).repeat(factor, axis=1).astype(np.uint8)


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
