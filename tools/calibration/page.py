"""The pieces of the calibration report that several parts need: tables, plots with axes, colours."""

import math
from collections.abc import Sequence

import numpy as np

from shared.arrays import DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, encode_srgb, lab_to_xyz
from tools.pictures.html import cell, row
from tools.pictures.html import table as table_of
from tools.pictures.plot import Plot, Span, round_step, ticks

_OTHER = "#b658c4"  # colour of what has no colour of its own
_PLANES = {"R": "#e5484d", "G": "#30a46c", "B": "#3e63dd", "W": "#8d8d86"}
_SIZE, _MARGINS = (560, 340), (64, 14, 12, 46)


def plane_colour(letter: str) -> str:
    """Return the CSS colour of a plane."""
    return _PLANES.get(letter, _OTHER)


def patch_style(colour: str) -> str:
    """Return the style of a mark in a plot that stands for a patch of this CSS colour."""
    return f"fill:{colour};stroke:var(--ink);stroke-width:.6"


def css_colours(lab: DoubleArray) -> list[str]:
    """Return CSS colours for L*a*b* (N, 3): sRGB, clipped."""
    encoded = encode_srgb((lab_to_xyz(lab) @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T).astype(np.float32))
    return ["#" + "".join(f"{round(255 * value):02x}" for value in row) for row in encoded.tolist()]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of texts; head: titles of the columns, empty = none."""
    return table_of(head, [row(map(cell, texts)) for texts in rows])


def axes(x: Span, y: Span, across: str, up: str, *, log: bool = False) -> Plot:
    """Return an empty plot with a grid and the names of both axes.

    x, y: first and last value on each axis.
    across, up: names.
    log: whether both axes are logarithmic.
    """
    plot = Plot(x, y, _SIZE, _MARGINS, log=log)
    plot.columns(_ticks(x, log=log))
    plot.rows(_ticks(y, log=log))
    plot.name_axes(across, up)
    return plot


def _ticks(span: Span, *, log: bool) -> list[float]:
    """Return round numbers inside a span: about five, or powers of ten."""
    if not log:
        return ticks(span, round_step(span[1] - span[0], 5))
    low, high = map(math.log10, span)
    return [10.0**power for power in ticks((low, high), max(1.0, round_step(high - low, 9)))]
