"""Two passes of shrinking every block of a picture in SciPy's DCT."""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import dctn, idctn

from shared.arrays import BoolArray, DoubleArray

Gains = Callable[[DoubleArray, DoubleArray, float], DoubleArray]
Variance = Callable[[float], float]


def transformed(plane: DoubleArray, size: int) -> DoubleArray:
    """[row, column]: the DCT of the block whose first pixel that is."""
    blocks: DoubleArray = dctn(sliding_window_view(plane, (size, size)), axes=(2, 3), norm="ortho")
    return blocks


def aggregated(plane: DoubleArray, guide: DoubleArray, sizes: tuple[int, ...], variance: Variance, gains: Gains) -> DoubleArray:
    """The mean of all blocks over each pixel, each weighted by its pixels over what is left of its noise."""
    sums, weights = np.zeros_like(plane), np.zeros_like(plane)
    for size in sizes:
        blocks, guides = transformed(plane, size), transformed(guide, size)
        for row, column in np.ndindex(*blocks.shape[:2]):
            noise = variance(float(guides[row, column, 0, 0]) / size)
            gain = gains(blocks[row, column], guides[row, column], noise)
            gain[0, 0] = 1.0
            weight = size**2 / (noise * (gain**2).sum())
            window = slice(row, row + size), slice(column, column + size)
            sums[window] += weight * idctn(gain * blocks[row, column], norm="ortho")
            weights[window] += weight
    return sums / weights


def denoise(
    noisy: DoubleArray, uncertain: BoolArray, sizes: tuple[int, ...], shot: float, read: float, threshold: float
) -> DoubleArray:
    margin = 2 * max(sizes)  # more than both passes see
    plane, doubtful = np.pad(noisy, margin, mode="reflect"), np.pad(uncertain, margin, mode="reflect")

    def variance(mean: float) -> float:
        return shot * max(mean, 0.0) + read**2

    first = aggregated(plane, plane, sizes, variance, lambda block, _, noise: np.where(block**2 < threshold**2 * noise, 0.0, 1.0))
    refilled = np.where(doubtful, first, plane)
    second = aggregated(refilled, first, sizes, variance, lambda _, guide, noise: guide**2 / (guide**2 + noise))
    return second[margin:-margin, margin:-margin]
