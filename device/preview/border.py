"""Samples beyond the edges of the frame, for a preview graph, which knows no edges.

The filter pattern continues outside the frame: each place takes the nearest sample at the same
place of the tile, down and across. A frame smaller than the tile may lack a filter; then the
nearest sample takes its place, whatever its filter.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import CodeArray, IndexArray


def copy_extended(
    codes: CodeArray, period: int, row: int, column: int, target: NDArray[Any]
) -> None:
    """Fill `target` with the rectangle of a frame of codes, (H, W), extended on all sides, that
    begins at this row and column.

    Parameters
    ----------
    period : int
        K of the filter pattern.
    row, column : int
        Counted from the first row and column of the frame; before it, or in it.
    """
    rows, columns = (
        _repeated(np.arange(first, first + count), size, period)
        for first, count, size in zip((row, column), target.shape, codes.shape, strict=True)
    )
    left, right = -column, codes.shape[1] - column
    # mostly without a copy
    inside = codes[row : row + len(rows)] if 0 <= row <= len(codes) - len(rows) else codes[rows]
    target[:, left:right] = inside
    target[:, :left], target[:, right:] = inside[:, columns[:left]], inside[:, columns[right:]]


def _repeated(places: IndexArray, size: int, period: int) -> IndexArray:
    """Nearest indices inside the frame with the same remainder modulo the period."""
    first = places % period
    last = first + (size - 1 - first) // period * period
    return np.clip(np.where(places < 0, first, np.where(places >= size, last, places)), 0, size - 1)
