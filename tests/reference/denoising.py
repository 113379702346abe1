"""Denoising of luminance: blocks of the picture are shrunk twice in SciPy's DCT, then mixed with non-local means."""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import dctn, idctn

from panchroma.offline.stages.denoising import DenoisingSettings
from panchroma.shared.arrays import BoolArray, DoubleArray

Gains = Callable[[DoubleArray, DoubleArray, DoubleArray], DoubleArray]
Variance = Callable[[DoubleArray], DoubleArray]


def aggregated(
    plane: DoubleArray, guide: DoubleArray, first: int, sizes: tuple[int, ...], variance: Variance, gains: Gains
) -> DoubleArray:
    """The weighted mean of the blocks of a quincunx that cover each pixel.

    first: row and column of the frame at row and column 0. A block's first row is even; half of it is even where its column is.
    The weight is (pixels / kept)^1.5 / noise, where `kept` is how many coefficients' worth of noise the gains leave.
    """
    sums, weights = np.zeros_like(plane), np.zeros_like(plane)
    for size in sizes:
        rows, columns = np.indices((plane.shape[0] - size + 1, plane.shape[1] - size + 1)) + first
        chosen = (rows % 2 == 0) & ((rows // 2 + columns) % 2 == 0)
        blocks, guides = (
            dctn(sliding_window_view(each, (size, size))[chosen], axes=(1, 2), norm="ortho") for each in (plane, guide)
        )
        noise = variance(guides[:, :1, :1] / size)
        gain = gains(blocks, guides, noise)
        gain[:, 0, 0] = 1.0
        weight = (size**2 / (gain**2).sum(axis=(1, 2), keepdims=True)) ** 1.5 / noise
        denoised = weight * idctn(gain * blocks, axes=(1, 2), norm="ortho")
        for row, column, block, heavy in zip(*np.nonzero(chosen), denoised, weight, strict=True):
            window = slice(row, row + size), slice(column, column + size)
            sums[window] += block
            weights[window] += heavy
    return sums / np.where(weights == 0, 1, weights)  # none covers some pixels at the edge, which the margin hides


def denoise(
    noisy: DoubleArray, uncertain: BoolArray, sizes: tuple[int, ...], shot: float, read: float, threshold: float
) -> DoubleArray:
    """Two passes of shrinkage: a hard threshold, then Wiener gains; the first result replaces `uncertain` samples in between."""
    margin = 2 * max(sizes)  # more than both passes see
    plane, doubtful = np.pad(noisy, margin, mode="reflect"), np.pad(uncertain, margin, mode="reflect")

    def variance(mean: DoubleArray) -> DoubleArray:
        return shot * np.maximum(mean, 0.0) + read**2

    first = aggregated(
        plane, plane, -margin, sizes, variance, lambda block, _, noise: np.where(block**2 < threshold**2 * noise, 0.0, 1.0)
    )
    refilled = np.where(doubtful, first, plane)
    second = aggregated(refilled, first, -margin, sizes, variance, lambda _, guide, noise: guide**2 / (guide**2 + noise))
    return second[margin:-margin, margin:-margin]


def denoise_luminance(
    noisy: DoubleArray, uncertain: BoolArray, shot: float, read: float, settings: DenoisingSettings
) -> DoubleArray:
    """Denoised luminance, (H, W): both passes of shrinkage."""
    shot, read = shot * settings.strength**2, read * settings.strength
    return denoise(noisy, uncertain, settings.sizes, shot, read, settings.threshold)
