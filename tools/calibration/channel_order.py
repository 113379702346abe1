"""Whether the chart's colours fit the names of the channels: if red and blue are exchanged, every other measurement still fits."""

from itertools import permutations

import numpy as np

from shared import CfaPattern
from shared.arrays import DoubleArray
from shared.colorimetry import SRGB_TO_XYZ
from shared.errors import InputError

from .colour_matrix import GREYS

_DARKEST = 0.02  # of white: colours outside sRGB have no logarithm
_NAMES = {"R": "red", "G": "green", "B": "blue", "C": "cyan", "M": "magenta", "Y": "yellow"}
# What sRGB's red, green and blue add up to, for the filters that may be exchanged with each other.
_KINDS = {"RGB": np.eye(3), "CMY": 1 - np.eye(3)}


def check_channel_order(levels: DoubleArray, reference: DoubleArray, pattern: CfaPattern) -> None:
    """Raise InputError if the channels R, G and B, or C, M and Y, see the chart's colours as if their names were exchanged.

    levels: (24, C), patches under one light, linear.
    reference: (24, 3), XYZ (D50), white = 1.
    pattern: of the shot.

    A matrix from camera RGB to XYZ undoes any exchange, so it cannot tell. But a filter called red is, however broad, more like the
    red of sRGB than a filter called blue is: the patches' colours, relative to grey, must be most alike in the order of the names.
    """
    shown = reference @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T
    for names, parts in _KINDS.items():
        if set(names) <= set(pattern.channels):
            _check_order(names, shown @ parts, levels[:, [pattern.channels.index(letter) for letter in names]], pattern)


def _check_order(names: str, shown: DoubleArray, levels: DoubleArray, pattern: CfaPattern) -> None:
    """Check the channels with these names; shown: (24, 3), what they should see; levels: (24, 3), what they see."""
    wanted, found = _hues(shown), _hues(levels)
    likeness = {order: float((wanted * found[:, order]).sum()) for order in permutations(range(3))}
    best = max(likeness, key=lambda order: likeness[order])
    if best == (0, 1, 2):
        return
    # Channel `order[i]` of the shot sees what the i-th name should.
    true = {letter: right for right, letter in zip(names, (names[index] for index in best), strict=True)}
    wrong = " and ".join(_NAMES[letter] for letter in names if true[letter] != letter)
    block = "/".join("".join(true.get(letter, letter) for letter in row) for row in pattern.letters_from())
    raise InputError(
        f"the chart shows that {wrong} are exchanged: the pattern in the shot does not fit its sensor, whose pattern probably is "
        f"{block}; capture the shot again with the right pattern"
    )


def _hues(levels: DoubleArray) -> DoubleArray:
    """Return the logarithms of the levels relative to grey and to the mean of the patch's channels, (24, C)."""
    parts = np.maximum(levels / levels[list(GREYS)].mean(axis=0), _DARKEST)
    logarithms = np.log(parts)
    return logarithms - logarithms.mean(axis=1, keepdims=True)
