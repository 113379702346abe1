"""Luminance around the blocks."""

import numpy as np

from .arrays import Bools2, Doubles2, Doubles3, Frozen2, Ints1, Ints2, Pair
from .compile import Pieces, kernel, parallel_kernel


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
