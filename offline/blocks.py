"""The samples of all whole colour blocks of a frame, site by site, and the panchromatic samples around them."""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BORDER, BoolArray, DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.pattern import BlockGrid, CfaPattern

from .kernels.outliers import surroundings

_WIDEST = 4  # pixels: the best on photographs among 1, 2 and 4, though sites have panchromatic neighbours


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """The blocks of `BlockGrid` that lie wholly inside the frame: B = (rows, columns) of them, with S sites each.

    origins: frame rows, and frame columns, of the blocks' first pixels.
    places: frame rows, and frame columns, of all sites, (*B, S) each.
    channels: (S,), channel index of each site.
    samples: float64 (*B, S), scene units.
    light: luminance at the sites, interpolated from the panchromatic samples around the block, float64 (*B, S), scene units.
    lowest, highest: range of the panchromatic samples around each block, float64 B, scene units.
    panchromatic: bool (K, K), the pattern from the frame's corner on.
    neighbours: number of panchromatic samples around a block.
    """

    origins: tuple[IndexArray, IndexArray]
    places: tuple[IndexArray, IndexArray]
    channels: IndexArray
    samples: DoubleArray
    light: DoubleArray
    lowest: DoubleArray
    highest: DoubleArray
    panchromatic: BoolArray
    neighbours: int


def gather(mosaic: Mosaic, signal: FloatArray) -> BlockSamples:
    """Collect the blocks of `signal`, (H, W), scene units, which has the mosaic's shape and pattern."""
    pattern, grid = mosaic.pattern, mosaic.pattern.grid(mosaic.shape)
    origins = grid.whole_rows, grid.whole_columns
    sites = np.array(pattern.sites)
    shape = len(origins[0]), len(origins[1]), len(sites)
    rows = np.broadcast_to(origins[0][:, None, None] + sites[:, 0], shape)
    columns = np.broadcast_to(origins[1][None, :, None] + sites[:, 1], shape)
    panchromatic = tile(mosaic)
    light, lowest, highest = np.empty(shape), np.empty(shape[:2]), np.empty(shape[:2])
    places = np.ascontiguousarray(sites[:, :2])
    surroundings(signal, panchromatic, *origins, pattern.block_shape, places, light, lowest, highest)
    samples = np.stack([signal[down, across] for _, down, across in block_sites(pattern, grid)], axis=2).astype(np.float64)
    (top, left), (down, across) = pattern.block_origin, pattern.block_shape
    neighbours = int(pattern.panchromatic_mask((down + 2, across + 2), (top - 1, left - 1)).sum())
    return BlockSamples(origins, (rows, columns), sites[:, 2], samples, light, lowest, highest, panchromatic, neighbours)


def sum_noise(blocks: BlockSamples, gamma: DoubleArray, noise: NoiseModel) -> DoubleArray:
    """Standard deviation of the noise in what a block's channels add up to, less the luminance around it; float64 B, scene units.

    That is sum_i gamma_i (mean of the samples of channel i), less the mean of the panchromatic samples around the block (Eq. 7).
    Shot noise is that of a grey block. For a Bayer block with gamma = (1, 1, 1) it is 1.6 times the noise of one sample.
    """
    shot, variance = np.array(noise.shot), np.array(noise.read) ** 2
    squares = (gamma / np.bincount(blocks.channels))[blocks.channels] ** 2
    per_light = squares @ shot[blocks.channels] / gamma.sum() + shot[-1] / blocks.neighbours
    fixed = squares @ variance[blocks.channels] + variance[-1] / blocks.neighbours
    sigma: DoubleArray = np.sqrt(per_light * np.maximum(blocks.light.mean(axis=2), 0) + fixed)
    return sigma


def tile(mosaic: Mosaic) -> BoolArray:
    """Which pixels are panchromatic, bool (K, K), from the frame's corner on."""
    return np.ascontiguousarray(mosaic.pattern.panchromatic_mask((mosaic.pattern.period, mosaic.pattern.period)))


def block_sites(pattern: CfaPattern, grid: BlockGrid) -> list[tuple[int, slice, slice]]:
    """(channel, rows, columns) for each colour site of a block: the slices of the frame that hold this site of all whole blocks."""
    rows, columns = grid.whole_rows, grid.whole_columns
    return [
        (channel, _every(rows + row, grid.period), _every(columns + column, grid.period)) for row, column, channel in pattern.sites
    ]


def _every(places: IndexArray, period: int) -> slice:
    """The slice that selects `places`, which are one period apart."""
    return slice(int(places[0]), int(places[-1]) + 1, period)


def curvature(luminance: FloatArray, site: list[slice], grid: BlockGrid) -> FloatArray:
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
