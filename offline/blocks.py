"""What the whole colour blocks of a frame read, each site by itself, and the panchromatic samples around them."""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic

from .kernels.outliers import surroundings


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """The blocks of `BlockGrid` that lie wholly inside the frame: B = (rows, columns) of them, with S sites each.

    origins: frame rows and columns of their first pixels; places: frame places of all sites, two of (*B, S); channels: (S,).
    samples: float64 (*B, S); light: luminance there, interpolated from the panchromatic samples around the block, float64 (*B, S);
    lowest, highest: of those, float64 B. panchromatic: (K, K), the pattern from the frame's corner on.
    """

    origins: tuple[IndexArray, IndexArray]
    places: tuple[IndexArray, IndexArray]
    channels: IndexArray
    samples: DoubleArray
    light: DoubleArray
    lowest: DoubleArray
    highest: DoubleArray
    panchromatic: BoolArray


def gather(mosaic: Mosaic, signal: FloatArray) -> BlockSamples:
    """The blocks of `signal`, which has the mosaic's shape and pattern."""
    pattern, grid = mosaic.pattern, mosaic.pattern.grid(mosaic.shape)
    origins = grid.whole_rows, grid.whole_columns
    sites = np.array(pattern.sites)
    shape = len(origins[0]), len(origins[1]), len(sites)
    rows = np.broadcast_to(origins[0][:, None, None] + sites[:, 0], shape)
    columns = np.broadcast_to(origins[1][None, :, None] + sites[:, 1], shape)
    panchromatic = tile(mosaic)
    light, lowest, highest = np.empty(shape), np.empty(shape[:2]), np.empty(shape[:2])
    surroundings(signal, panchromatic, *origins, pattern.block_shape, sites[:, :2], light, lowest, highest)
    samples = signal[rows, columns].astype(np.float64)
    return BlockSamples(origins, (rows, columns), sites[:, 2], samples, light, lowest, highest, panchromatic)


def tile(mosaic: Mosaic) -> BoolArray:
    """Which pixels are panchromatic, (K, K), from the frame's corner on."""
    return np.ascontiguousarray(mosaic.pattern.panchromatic_mask((mosaic.pattern.period, mosaic.pattern.period)))
