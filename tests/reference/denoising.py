"""Denoising of luminance: blocks of the picture are shrunk twice in SciPy's DCT, then mixed with non-local means."""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import dctn, idctn
from scipy.ndimage import convolve

from offline.settings import DenoisingSettings
from shared.arrays import BoolArray, DoubleArray

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


def similar_mean(samples: DoubleArray, guide: DoubleArray, shot: float, read: float, similarity: float, radius: int) -> DoubleArray:
    """Non-local means of `samples`; the weights compare the surroundings in `guide`, in standard deviations of the noise."""
    even = 2 / shot * np.sqrt(np.maximum(shot * guide + read**2, 0)) if shot else guide / read
    height, width = guide.shape
    wide, values = np.pad(even, radius + 1, mode="reflect"), np.pad(samples, radius, mode="reflect")
    binomial = np.outer([1, 2, 1], [1, 2, 1]) / 16
    sums, weights = np.zeros_like(guide), np.zeros_like(guide)
    for down in range(2 * radius + 1):
        for right in range(2 * radius + 1):
            there = wide[down : down + height + 2, right : right + width + 2]
            here = wide[radius : radius + height + 2, radius : radius + width + 2]
            distance = convolve((there - here) ** 2, binomial)[1:-1, 1:-1] / similarity**2
            weight = np.maximum(1 - distance / 8, 0) ** 4  # nearly exp(-distance / 2)
            sums += weight * values[down : down + height, right : right + width]
            weights += weight
    return sums / weights


def denoise_luminance(
    noisy: DoubleArray, uncertain: BoolArray, shot: float, read: float, settings: DenoisingSettings
) -> DoubleArray:
    """Denoised luminance, (H, W): both passes of shrinkage, mixed with non-local means where noise is 2 to 4 % of the light."""
    shot, read = shot * settings.strength**2, read * settings.strength
    clean = denoise(noisy, uncertain, settings.sizes, shot, read, settings.threshold)
    samples = np.where(uncertain, clean, noisy)
    mean, share = similar_mean(samples, clean, shot, read, settings.similarity, settings.radius), np.empty_like(clean)
    for row in range(0, len(clean), 128):
        for column in range(0, clean.shape[1], 256):
            window = slice(row, row + 128), slice(column, column + 256)
            light = noisy[window].mean()
            share[window] = settings.share * np.interp(np.sqrt(max(shot * light + read**2, 0)) / light, (0.02, 0.04), (0, 1))
    return clean + share * (mean - clean)
