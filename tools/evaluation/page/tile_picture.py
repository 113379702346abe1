"""A picture of a filter pattern: small squares in the colours of its filters."""

from html import escape

from shared import CfaPattern
from shared.pattern import PANCHROMATIC

_FILLS = {"R": "#d6402c", "G": "#3a9a48", "B": "#3465c9", "C": "#17a5b8", "M": "#c2419b", "Y": "#d9b310", PANCHROMATIC: "#f4f4f1"}
_SIDE = 12  # SVG units of a pixel


def tile_picture(pattern: CfaPattern) -> str:
    """The SVG element of one tile. Filters without a colour of their own name get a hue in the order of the channels."""
    squares = []
    for row, letters in enumerate(pattern.tile):
        for column, letter in enumerate(letters):
            fill = _FILLS.get(letter) or f"hsl({360 * pattern.channels.index(letter) / len(pattern.channels):.0f} 55% 45%)"
            x, y = column * _SIDE, row * _SIDE
            squares.append(f'<rect x="{x}" y="{y}" width="{_SIDE}" height="{_SIDE}" fill="{fill}"/>')
            if letter != PANCHROMATIC:
                squares.append(f'<text x="{x + _SIDE / 2:g}" y="{y + 0.77 * _SIDE:g}">{escape(letter)}</text>')
    side = pattern.period * _SIDE
    return f'<svg viewBox="0 0 {side} {side}" role="img" aria-label="{"/".join(pattern.tile)}">{"".join(squares)}</svg>'
