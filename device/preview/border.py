"""Samples beyond the edges of the frame, for a preview graph, which knows no edges.

The filter pattern continues outside the frame. A panchromatic pixel there takes the sample of its mirror image if that is
panchromatic too. Every other pixel takes the nearest sample at the same place of the tile, so that a colour block that lies
outside, or is cut by the edge, repeats the nearest one inside.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import CodeArray, IndexArray, mirrored
from shared.pattern import CfaPattern

Span = tuple[int, int]


class ExtendedFrame:
    """A frame of codes, extended on all sides.

    codes: (H, W) uint16.
    pattern: the filter pattern of the frame.
    rows, columns: (first, last + 1) of the extended frame, counted from the first row or column of the frame, which lies within.
    A frame smaller than the tile may lack a filter; then the nearest sample takes its place, whatever its filter.
    """

    def __init__(self, codes: CodeArray, pattern: CfaPattern, rows: Span, columns: Span) -> None:
        self._codes, self._rows, self._columns = codes, rows, columns
        height, width = codes.shape
        self._above = _outside(codes, pattern, (rows[0], 0), columns)
        self._below = _outside(codes, pattern, (height, rows[1]), columns)
        self._left = _outside(codes, pattern, (0, height), (columns[0], 0))
        self._right = _outside(codes, pattern, (0, height), (width, columns[1]))

    def copy_rows(self, first: int, target: NDArray[Any]) -> None:
        """Fill `target`, (n, all columns), with the n rows from `first` on."""
        (height, width), left = self._codes.shape, -self._columns[0]
        begin, end = (min(max(row, 0), height) - first for row in (first, first + len(target)))
        target[:begin] = self._above[first - self._rows[0] :][:begin]
        inner = slice(first + begin, first + end)
        target[begin:end, :left] = self._left[inner]
        target[begin:end, left : left + width] = self._codes[inner]
        target[begin:end, left + width :] = self._right[inner]
        target[end:] = self._below[max(first - height, 0) :][: len(target) - end]


def _outside(codes: CodeArray, pattern: CfaPattern, rows: Span, columns: Span) -> CodeArray:
    """Samples at rows x columns, which lie partly or wholly outside the frame."""
    images, others, nearest = _places(pattern, (codes.shape[0], codes.shape[1]), rows, columns)
    samples = codes[images[0]][:, images[1]].copy()
    samples[others] = codes[nearest]
    return samples


@lru_cache(maxsize=4)  # the four sides of the frames of one stream
def _places(
    pattern: CfaPattern, shape: tuple[int, int], rows: Span, columns: Span
) -> tuple[list[slice | IndexArray], tuple[IndexArray, ...], tuple[IndexArray, ...]]:
    """Rows and columns of the mirror images, of the places that do not take theirs (within rows x columns), and of what they take.

    Looking up the few others is faster than choosing between two samples everywhere.
    """
    places = np.arange(*rows), np.arange(*columns)
    images = [mirrored(place, size) for place, size in zip(places, shape, strict=True)]
    tile = pattern.filter_map((pattern.period, pattern.period)) == len(pattern.channels)
    clear, clear_image = (tile[np.ix_(*(axis % pattern.period for axis in axes))] for axes in (places, images))
    others = np.nonzero(~(clear & clear_image))
    nearest = (_repeated(place[index], size, pattern.period) for place, index, size in zip(places, others, shape, strict=True))
    return [_run(image) for image in images], others, tuple(nearest)


def _run(places: IndexArray) -> slice | IndexArray:
    """Places that follow one another, up or down, as a slice: ten times as fast as a list."""
    steps = np.unique(np.diff(places))
    if len(steps) != 1 or abs(step := int(steps[0])) != 1:
        return places
    end = int(places[-1]) + step
    return slice(int(places[0]), end if end >= 0 else None, step)


def _repeated(places: IndexArray, size: int, period: int) -> IndexArray:
    """Nearest indices inside the frame with the same remainder modulo the period."""
    first = places % period
    last = first + (size - 1 - first) // period * period
    inside = np.where(places < 0, first, np.where(places >= size, last, places))
    return np.clip(inside, 0, size - 1)
