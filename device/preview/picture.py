"""The last stages of a preview graph: camera RGB in planes -> the picture. For the rules of its
operations see `graph`.
"""

import numpy as np

from ...shared.display import SATURATED
from . import contract
from .nodes import END
from .pattern_graph import PatternGraph

# The curve of IEC 61966-2-1 without a power: OFFSET + GAIN (s - BEND / s), s = sqrt(x + SHIFT) +
# KNEE, in codes of 8 bits. Fitted: its error is at most 0.53 codes, 0.31 on average, and 0 at black
# and white.
_SHIFT, _OFFSET, _GAIN, _BEND, _KNEE = 0.002321567, 3, 221.8983454, 0.05906647, 0.1866531

_BURNT = 50.0
"""Multiple of the luminance of saturated macropixels that is shown: white where every channel has a
fiftieth of what white has.
"""


def in_picture_units(g: PatternGraph, ratios: str) -> str:
    """Chromaticities that, times luminance in codes, give scene units in a linear graph, else
    fractions of display white.

    Parameters
    ----------
    ratios : str
        gamma_j c_j, (C, blocks).
    """
    per_code = g("Div", g.unit, contract.GAMMA)
    if not g.linear:
        per_code = g("Div", per_code, contract.WHITE)
    return g("Mul", ratios, g("Unsqueeze", per_code, [1, 2]))


def burnt_out(g: PatternGraph, coarse: str) -> str:
    """Divisor of the colour of each macropixel, (1, macropixels, patches): 1, or less where samples
    are saturated, so that it is white.

    There the measured luminance is too low, and chromaticity wrong (see `shared.display`).

    Parameters
    ----------
    coarse : str
        The mean luminance of each macropixel.
    """
    first, last = SATURATED
    fall = (1 - 1 / _BURNT) / (last - first)
    inner = g.inner(g.full_scale)  # a patch is in the middle of the blocks at its corners
    ends = (0, -1), (1, END)
    corners = [g("Slice", inner, [first] * 2, [last] * 2, [1, 2]) for first, last in ends]
    slope = g("Div", -2 * fall, g("Add", *corners))
    return g("Clip", g("Add", g("Mul", coarse, slope), 1 + fall * first), 1 / _BURNT, 1.0)


def display(g: PatternGraph, camera: str) -> str:
    """Convert camera RGB relative to display white, (m, C, ...), to sRGB codes, uint8 (m, 3, n), as
    `ColourTransform` does.
    """
    flat = g("Reshape", g("Clip", camera, -1.0, 1.0), [0, 0, -1])
    # A sum of C products, which the kernels of all processors add in order; the only place where a
    # multiply-add may be fused. x86 without that instruction rounds otherwise: some 90 bytes of a
    # 12-megapixel picture differ by one.
    linear = g("Conv", flat, g("Unsqueeze", contract.MATRIX, [2]), np.full(3, _SHIFT))
    root = g("Add", g("Sqrt", g("Clip", linear, _SHIFT, 2.0)), _KNEE)
    curve = g("Sub", root, g("Div", _BEND, root))
    return g("QuantizeLinear", curve, 1 / _GAIN, np.array(_OFFSET, np.uint8))


def interleave(g: PatternGraph, planes: list[str]) -> str:
    """Assemble the picture (rows, columns, channels) from its planes, (pixels, channels,
    macropixels, patches) in one tensor or more.
    """
    within, across, channels = g.geometry.within, g.geometry.across, g.shown
    values = planes[0]
    if len(planes) > 1:
        flat = (g("Reshape", plane, [1, channels, -1]) for plane in planes)
        values = g("Concat", *flat, axis=0)
    values = g.reshape(values, [within, within, channels, across, across, *g.patches])
    # Depth to space in two steps: move whole rows of patches into place, then interleave the
    # columns.
    values = g("Transpose", values, perm=[5, 3, 0, 4, 1, 2, 6])
    values = g.reshape(values, [-1, within * across * channels, g.patches[1]])
    return g("Reshape", g("Transpose", values, perm=[0, 2, 1]), [0, -1, channels])
