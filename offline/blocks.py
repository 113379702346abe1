"""The colour sites of all whole blocks of a frame, what they read, and the panchromatic samples around the blocks.

Luminance around the blocks.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from shared.arrays import BORDER, BoolArray, DoubleArray, FloatArray, IndexArray
from shared.block_grid import BlockGrid
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern

from .numerics.arrays import Bools2, Doubles2, Doubles3, Frozen2, Ints1, Ints2, Pair
from .numerics.compile import Pieces, kernel, parallel_kernel
from .numerics.pieces import BLOCK_ROWS, in_strips

_WIDEST = 4  # pixels: the best on photographs among 1, 2 and 4, though sites have panchromatic neighbours


@dataclass(frozen=True)
class Sites:
    """The colour sites of the B = (rows, columns) blocks of a frame that lie wholly inside it, S sites in each.

    >>> import numpy as np
    >>> from offline.blocks import Sites
    >>> from shared import CfaPattern
    >>> pattern = CfaPattern.bayer(6)
    >>> sites = Sites(pattern, pattern.grid((13, 20)))
    >>> sites.shape, sites.of(np.zeros((13, 20))).shape
    ((2, 4), (2, 4, 4))
    """

    pattern: CfaPattern
    grid: BlockGrid

    @classmethod
    def in_frame(cls, mosaic: Mosaic) -> "Sites":
        """The sites of a mosaic."""
        return cls(mosaic.pattern, mosaic.pattern.grid(mosaic.shape))

    @property
    def shape(self) -> tuple[int, int]:
        """B, the number of whole blocks (down, across)."""
        return len(self.grid.whole_rows), len(self.grid.whole_columns)

    @cached_property
    def channels(self) -> IndexArray:
        """The channel of each site, (S,)."""
        return np.array([channel for *_, channel in self.pattern.sites], np.intp)

    @cached_property
    def places(self) -> list[tuple[slice, slice]]:
        """For each site the slices of the frame's rows and columns that hold it in all whole blocks."""
        rows, columns = self.grid.whole_rows, self.grid.whole_columns
        return [(self._every(rows + row), self._every(columns + column)) for row, column, _ in self.pattern.sites]

    def at(self, rows: slice, first: int = 0) -> list[tuple[slice, slice]]:
        """As `places`, for these rows of blocks, 1 or more, in a plane whose first row is the frame's row `first`."""
        period, count = self.grid.period, rows.stop - rows.start
        starts = [down.start + rows.start * period - first for down, _ in self.places]
        return [
            (slice(start, start + (count - 1) * period + 1, period), columns)
            for start, (_, columns) in zip(starts, self.places, strict=True)
        ]

    @property
    def pixels(self) -> tuple[IndexArray, IndexArray]:
        """Row and column of every site in the frame, (*B, S) each."""
        sites = np.array(self.pattern.sites)
        down, across = self.grid.whole_rows[:, None, None] + sites[:, 0], self.grid.whole_columns[None, :, None] + sites[:, 1]
        rows, columns = np.broadcast_arrays(down, across)
        return rows, columns

    @property
    def middle(self) -> tuple[float, float]:
        """Row and column of the middle of the first whole block."""
        down, across = self.pattern.block_shape
        return float(self.grid.whole_rows[0]) + (down - 1) / 2, float(self.grid.whole_columns[0]) + (across - 1) / 2

    @property
    def neighbours(self) -> int:
        """Number of panchromatic samples around a block."""
        (top, left), (down, across) = self.pattern.block_origin, self.pattern.block_shape
        return int(self.pattern.panchromatic_mask((down + 2, across + 2), (top - 1, left - 1)).sum())

    def of(self, plane: NDArray[Any], dtype: DTypeLike | None = None) -> NDArray[Any]:
        """The values of a plane, (H, W), at all sites, (*B, S). dtype: of the result; None = that of the plane."""
        values = np.empty((*self.shape, len(self.places)), dtype or plane.dtype)

        def work(rows: slice) -> None:
            np.stack([plane[place] for place in self.at(rows)], axis=2, out=values[rows])

        in_strips(work, self.shape[0], BLOCK_ROWS)
        return values

    def means(self, values: NDArray[Any]) -> NDArray[Any]:
        """The means of values, (*B, S), over the sites of each channel, (*B, C)."""
        return np.stack([values[..., self.channels == each].mean(axis=2) for each in range(len(self.pattern.channels))], axis=2)

    def whole(self, blocks: FloatArray) -> FloatArray:
        """The whole blocks, (*B, C), of all blocks of the grid, (block rows, block columns, C); a view."""
        return blocks[self.grid.whole]

    def surroundings(self, signal: FloatArray) -> "Surroundings":
        """What the panchromatic samples of a plane, (H, W), are around each block."""
        shape, places = (*self.shape, len(self.pattern.sites)), np.array(self.pattern.sites, np.intp)[:, :2]
        light, lowest, highest = np.empty(shape), np.empty(self.shape), np.empty(self.shape)
        origins = self.grid.whole_rows, self.grid.whole_columns
        places = np.ascontiguousarray(places)
        surroundings(signal, tile(self.pattern), *origins, self.pattern.block_shape, places, light, lowest, highest)
        return Surroundings(light, lowest, highest)

    def _every(self, places: IndexArray) -> slice:
        """The slice that selects `places`, which are one period apart."""
        return slice(int(places[0]), int(places[-1]) + 1, self.grid.period)


class Surroundings(NamedTuple):
    """The panchromatic samples around blocks, float64, scene units.

    light: luminance at the sites, interpolated from them, (*B, S).
    lowest, highest: their range, B.
    """

    light: DoubleArray
    lowest: DoubleArray
    highest: DoubleArray


@dataclass(frozen=True, eq=False)
class BlockSums:
    """The sums of Eqs. 8-9 of each whole block for each channel, float64 (rows, columns, C); those of several frames add up.

    weight: sum l^2 over the sites of the channel. product: sum l m.
    """

    weight: DoubleArray
    product: DoubleArray

    def __add__(self, other: "BlockSums") -> "BlockSums":
        return BlockSums(self.weight + other.weight, self.product + other.product)

    def solved(self, sigma: float, gamma: DoubleArray, expected: DoubleArray | None = None) -> DoubleArray:
        """Chromaticities, (rows, columns, C): the exact minimiser of Eqs. 8-9 under sum_i gamma_i c_i = 1, by a multiplier.

        sigma: sigma_z > 0, in the units of l.
        gamma: (C,), the weights of Eq. 7.
        expected: what they are pulled towards, as the result; None = grey, as in the paper.
        """
        found = np.empty_like(self.weight)

        def work(rows: slice) -> None:
            a = self.weight[rows] + sigma**2
            towards = sigma**2 / gamma.sum() if expected is None else sigma**2 * expected[rows]
            free = (self.product[rows] + towards) / a  # Eqs. 8-9 without the constraint
            pull = gamma / a
            missing = 1 - free @ gamma
            found[rows] = free + pull * (missing / (pull @ gamma))[..., None]

        in_strips(work, len(found), BLOCK_ROWS)
        return found


def sum_noise(sites: Sites, light: DoubleArray, gamma: DoubleArray, noise: NoiseModel) -> DoubleArray:
    """Standard deviation of the noise in what a block's channels add up to, less the luminance around it; float64 B, scene units.

    That is sum_i gamma_i (mean of the samples of channel i), less the mean of the panchromatic samples around the block (Eq. 7).
    Shot noise is that of a grey block. For a Bayer block with gamma = (1, 1, 1) it is 1.6 times the noise of one sample.
    light: luminance at the sites, (*B, S).
    """
    shot, variance = np.array(noise.shot), np.array(noise.read) ** 2
    squares = (gamma / np.bincount(sites.channels))[sites.channels] ** 2
    per_light = squares @ shot[sites.channels] / gamma.sum() + shot[-1] / sites.neighbours
    fixed = squares @ variance[sites.channels] + variance[-1] / sites.neighbours
    return np.sqrt(per_light * np.maximum(light.mean(axis=2), 0) + fixed)


def tile(pattern: CfaPattern) -> BoolArray:
    """Which pixels are panchromatic, bool (K, K), from the frame's corner on."""
    return np.ascontiguousarray(pattern.panchromatic_mask((pattern.period, pattern.period)))


def curvature(luminance: FloatArray, site: tuple[slice, slice], grid: BlockGrid) -> FloatArray:
    """How far luminance at a site is from the mean of the pixels one block's size to either side; the larger of both axes.

    The error of filled luminance grows with it. A block that is a whole tile counts as `_WIDEST` pixels wide at most.
    site: slices of the rows and columns of `luminance`.
    """
    is_tile = grid.block_shape == (grid.period, grid.period)
    block = (min(grid.period, _WIDEST),) * 2 if is_tile else grid.block_shape
    here = luminance[*site]
    found = np.zeros_like(here)
    places = [np.arange(each.start, each.stop, each.step) for each in site]
    for axis, step in enumerate(block):
        pair = np.zeros_like(here)
        for side in (-step, step):
            there = list(places)
            wide = np.pad(np.arange(luminance.shape[axis]), step, mode=BORDER)
            there[axis] = wide[there[axis] + side + step]
            pair += luminance[np.ix_(*there)] / 2
        found = np.maximum(found, np.abs(pair - here))
    return found


@parallel_kernel()
def surroundings(
    pieces: Pieces,
    signal: Frozen2,
    panchromatic: Bools2,
    rows: Ints1,
    columns: Ints1,
    extent: Pair,
    sites: Ints2,
    light: Doubles3,
    lowest: Doubles2,
    highest: Doubles2,
) -> None:
    """Interpolate luminance at the colour sites of blocks from the panchromatic samples around each block.

    signal: (H, W), scene units.
    panchromatic: bool (K, K), the pattern from the frame's corner on.
    rows, columns: the blocks' first rows, and first columns.
    extent: (rows, columns) of a block.
    sites: (S, 2), row and column of each site in a block.
    light: (blocks down, blocks across, S), written: means weighted by one over the squared distance; 0 without samples.
    lowest, highest: (blocks down, blocks across), written: the range of the samples.
    """
    weights = _weights(panchromatic, rows[0], columns[0], extent, sites)
    for i in range(pieces[0], pieces[1]):
        total, weight = np.empty(len(sites)), np.empty(len(sites))
        top, bottom = max(rows[i] - 1, 0), min(rows[i] + extent[0] + 1, signal.shape[0])
        for j in range(len(columns)):
            left, right = max(columns[j] - 1, 0), min(columns[j] + extent[1] + 1, signal.shape[1])
            low, high = np.inf, -np.inf
            total[:], weight[:] = 0.0, 0.0
            for y in range(top, bottom):
                for x in range(left, right):
                    near = weights[y - rows[i] + 1, x - columns[j] + 1]
                    if near[0] > 0.0:
                        value = signal[y, x]
                        low, high = min(low, value), max(high, value)
                        for site in range(len(sites)):
                            total[site] += near[site] * value
                            weight[site] += near[site]
            for site in range(len(sites)):
                light[i, j, site] = total[site] / weight[site] if weight[site] > 0.0 else 0.0
            lowest[i, j], highest[i, j] = low, high


@kernel
def _weights(panchromatic: Bools2, row: int, column: int, extent: Pair, sites: Ints2) -> Doubles3:
    """One over the squared distance between each pixel of a block with its surroundings and each site; 0 at colour sites."""
    period = len(panchromatic)
    weights = np.zeros((extent[0] + 2, extent[1] + 2, len(sites)))
    for y in range(-1, extent[0] + 1):
        for x in range(-1, extent[1] + 1):
            if panchromatic[(row + y) % period, (column + x) % period]:
                for site in range(len(sites)):
                    weights[y + 1, x + 1, site] = 1.0 / ((y - sites[site, 0]) ** 2 + (x - sites[site, 1]) ** 2)
    return weights
