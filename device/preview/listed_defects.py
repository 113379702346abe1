"""Listed defects, for a preview graph, which knows none: their samples are replaced before the graph reads the frame.

A defect of a panchromatic pixel is the mean of the two opposite neighbours that differ least. A colour sample that does not measure
light has none of its filter beside it. It is predicted by those of the same filter in the blocks around: by their share in the
light beside them, each the more it counts the nearer this light is to that beside the defect.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from shared.arrays import BoolArray, CodeArray, DoubleArray, FloatArray, IndexArray
from shared.pattern import CfaPattern

_PAIRS = np.array([[(0, -1), (0, 1)], [(-1, 0), (1, 0)], [(-1, -1), (1, 1)], [(-1, 1), (1, -1)]])
"""Steps to opposite neighbours of a pixel, the near ones first."""
_LIKE = 4
"""A sample of another block counts by this power of the lesser light over the greater: ink is not predicted by paper."""
_Weighed = Callable[[IndexArray, int], tuple[DoubleArray, DoubleArray | BoolArray]]
"""(Indices of places, a size) -> samples around the places times their weights, and the weights, (places, samples)."""
_HIGHEST = (1 << 16) - 1
_AT_ONCE = 1 << 13  # defects: a sensor may have many, and each reads a hundred samples


def without_defects(
    codes: CodeArray,
    pattern: CfaPattern,
    defects: tuple[tuple[int, int], ...],
    black: FloatArray | DoubleArray,
    scale: FloatArray | DoubleArray,
    grey: float,
) -> CodeArray:
    """The codes of a frame, uint16 (H, W), with the samples of its defects replaced; `codes` itself if it has none.

    pattern: the filter pattern of the frame.
    defects: (row, column) of each; those outside of the frame are ignored.
    black, scale: black level and scene units per code of each plane (the channels, then panchromatic).
    grey: light of a channel over panchromatic light in a grey scene, for a frame without a good sample of a channel.

    >>> import numpy as np
    >>> from device.preview.listed_defects import without_defects
    >>> from shared import CfaPattern
    >>> codes = np.full((12, 12), 100, np.uint16)
    >>> codes[5, 5] = 4095
    >>> int(without_defects(codes, CfaPattern.bayer(6), ((5, 5),), np.zeros(4), np.ones(4), 1 / 3)[5, 5])
    100
    """
    places = np.array(defects, np.intp).reshape(-1, 2)
    places = places[(places < codes.shape).all(axis=1)]
    if not len(places):
        return codes
    bad = np.sort(np.ravel_multi_index(tuple(places.T), codes.shape))
    frame = _Frame(codes, pattern, bad, black.astype(float), scale.astype(float), grey)
    tile = pattern.filter_map((pattern.period, pattern.period))
    kinds = (places % pattern.period) @ (pattern.period, 1)
    kinds[tile.ravel()[kinds] == len(pattern.channels)] = -1  # all panchromatic pixels alike; sites have their own surroundings
    mended = codes.copy()
    for kind in np.unique(kinds):
        plane = len(pattern.channels) if kind < 0 else int(tile.ravel()[kind])
        of_kind = places[kinds == kind]
        for some in np.array_split(of_kind, -(-len(of_kind) // _AT_ONCE)):
            rows, columns = some.T
            light = frame.panchromatic(rows, columns) if kind < 0 else frame.colour(rows, columns, plane)
            mended[rows, columns] = np.rint(light / frame.scale[plane] + frame.black[plane]).clip(0, _HIGHEST)
    return mended


@dataclass(frozen=True)
class _Frame:
    """A frame of codes with defects. bad: places of the defects, row * W + column, rising; for the others see `without_defects`."""

    codes: CodeArray
    pattern: CfaPattern
    bad: IndexArray
    black: DoubleArray
    scale: DoubleArray
    grey: float

    def read(self, rows: IndexArray, columns: IndexArray, plane: int) -> tuple[DoubleArray, BoolArray]:
        """Light in scene units at each place, and whether a good sample of this plane measured it; 0 where none did."""
        (height, width), period = self.codes.shape, self.pattern.period
        good = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        good &= self.pattern.filter_map((period, period))[rows % period, columns % period] == plane
        here = np.where(good, rows * width + columns, 0)
        good &= self.bad[np.searchsorted(self.bad, here).clip(max=len(self.bad) - 1)] != here
        light = (self.codes.ravel()[here] - self.black[plane]) * self.scale[plane]
        return np.where(good, light, 0.0), good

    def panchromatic(self, rows: IndexArray, columns: IndexArray) -> DoubleArray:
        """Light at panchromatic places: of the pair of opposite neighbours that differ least, else of all around."""
        one, good = self._around(rows, columns, _PAIRS[:, 0])
        other, fine = self._around(rows, columns, _PAIRS[:, 1])
        apart = np.where(good & fine, np.abs(one - other), np.inf)
        each, best = np.arange(len(rows)), np.argmin(apart, axis=1)
        found: DoubleArray = ((one + other) / 2)[each, best]
        alone = ~np.isfinite(apart[each, best])
        found[alone] = self.light_beside(rows[alone], columns[alone])
        return found

    def light_beside(self, rows: IndexArray, columns: IndexArray) -> DoubleArray:
        """Mean of the nearest good panchromatic samples around each place: those of the smallest square that has any; else 0."""

        def on_edge(left: IndexArray, size: int) -> tuple[DoubleArray, BoolArray]:
            steps = _square(size)
            return self._around(rows[left], columns[left], steps[np.abs(steps).max(axis=1) == size])

        return _widened(np.zeros(len(rows)), on_edge, range(1, 2 * self.pattern.period + 1))

    def colour(self, rows: IndexArray, columns: IndexArray, channel: int) -> DoubleArray:
        """Light at places of one site, predicted by the good samples of its channel in the blocks around, or further away."""
        here = np.maximum(self.light_beside(rows, columns), self.scale[-1])
        period = self.pattern.period
        planes = self.pattern.filter_map((period, period), (int(rows[0]), int(columns[0])))  # all places are one of the tile

        def in_blocks(left: IndexArray, blocks: int) -> tuple[DoubleArray, DoubleArray]:
            steps = _square(blocks * period)
            steps = steps[(planes[tuple(steps.T % period)] == channel) & steps.any(axis=1)]
            down, across = rows[left, None] + steps[:, 0], columns[left, None] + steps[:, 1]
            light, good = self.read(down, across, channel)
            beside = np.maximum(self.light_beside(down.ravel(), across.ravel()).reshape(good.shape), self.scale[-1])
            like = good * np.minimum(beside / here[left, None], here[left, None] / beside) ** _LIKE
            return like * light / beside, like

        return _widened(np.full(len(rows), self.grey), in_blocks, (1, 2, 4)) * here

    def _around(self, rows: IndexArray, columns: IndexArray, steps: IndexArray) -> tuple[DoubleArray, BoolArray]:
        """`read` of panchromatic samples at `steps` (n, 2) from each place: (places, n)."""
        return self.read(rows[:, None] + steps[:, 0], columns[:, None] + steps[:, 1], len(self.pattern.channels))


def _widened(means: DoubleArray, weighed: _Weighed, sizes: Iterable[int]) -> DoubleArray:
    """Weighted means (n,) of what the first size has around each place that has any weight there; where none has, `means`."""
    left = np.arange(len(means))
    for size in sizes:
        if not len(left):
            break
        samples, weights = weighed(left, size)
        weight = weights.sum(axis=1)
        known = weight > 0
        means[left[known]] = samples.sum(axis=1)[known] / weight[known]
        left = left[~known]
    return means


def _square(reach: int) -> IndexArray:
    """Steps (n, 2) to the pixels of the square around a pixel that goes `reach` pixels each way."""
    return np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
