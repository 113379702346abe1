"""Samples beyond the edges of the frame, for a preview graph, which knows no edges.

The filter pattern continues outside the frame: each place takes the nearest sample at the same place of the tile, down and across.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import CodeArray, IndexArray
from ...shared.pattern import CfaPattern

Span = tuple[int, int]


class ExtendedFrame:
    """A frame of codes, extended on all sides.

    codes: (H, W) uint16.
    pattern: the filter pattern of the frame.
    rows, columns: (first, last + 1) of the extended frame, counted from the first row or column of the frame, which lies within.
    A frame smaller than the tile may lack a filter; then the nearest sample takes its place, whatever its filter.
    """

    def __init__(self, codes: CodeArray, pattern: CfaPattern, rows: Span, columns: Span) -> None:
        self._codes, self._first = codes, rows[0]
        self._rows, places = (
            _repeated(np.arange(*span), size, pattern.period) for span, size in zip((rows, columns), codes.shape, strict=True)
        )
        self._left, self._right = places[: -columns[0]], places[codes.shape[1] - columns[0] :]

    def copy_rows(self, first: int, target: NDArray[Any]) -> None:
        """Fill `target`, (n, all columns), with the n rows from `first` on."""
        (height, width), end = self._codes.shape, first + len(target)
        inside = first >= 0 and end <= height
        rows = self._codes[first:end] if inside else self._codes[self._rows[first - self._first : end - self._first]]
        left = len(self._left)
        target[:, :left], target[:, left + width :] = rows[:, self._left], rows[:, self._right]
        target[:, left : left + width] = rows


def _repeated(places: IndexArray, size: int, period: int) -> IndexArray:
    """Nearest indices inside the frame with the same remainder modulo the period."""
    first = places % period
    last = first + (size - 1 - first) // period * period
    inside = np.where(places < 0, first, np.where(places >= size, last, places))
    return np.clip(inside, 0, size - 1)
