"""Means and variances of the mosaic's own samples, place by place: nothing is reconstructed, so nothing is assumed.

Levels are parts of full scale: (code - black) / (white - black). Eq. 7 holds in them with the very same gamma as in scene units,
because full scale is one figure for all planes; that is why gamma can be measured without knowing it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shared import Mosaic
from shared.arrays import BoolArray, DoubleArray, FloatArray

CLIPPED = 0.985  # of full scale: nearer to it noise would have been cut off
_OUTLIER = 5.0  # standard deviations: dust, glints, hot pixels. One Gaussian sample in two million
_MAD = 1.4826  # standard deviations of a Gaussian, per median absolute deviation


@dataclass(frozen=True, eq=False)
class Region:
    """Pixels of a place: rows and columns from `top`, `left`, and which of them belong to it."""

    top: int
    left: int
    mask: BoolArray


@dataclass(frozen=True, eq=False)
class PlaceSamples:
    """Statistics of N places, per plane (the channels, then panchromatic), in parts of full scale.

    mean: (N, C + 1), at the centre of each place; variance: (N, C + 1), of a single sample about the place's shading;
    count: (N, C + 1) samples; clipped: (N,), whether a sample lies at the white level; centre: (N, 2) sensor row and column.
    """

    mean: DoubleArray
    variance: DoubleArray
    count: DoubleArray
    clipped: BoolArray
    centre: DoubleArray

    def chosen(self, which: BoolArray) -> "PlaceSamples":
        """The places where `which` (N,) is true."""
        return PlaceSamples(self.mean[which], self.variance[which], self.count[which], self.clipped[which], self.centre[which])

    @staticmethod
    def joined(parts: Sequence["PlaceSamples"]) -> "PlaceSamples":
        """The places of several shots, one after the other."""
        return PlaceSamples(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("mean", "variance", "count", "clipped", "centre")
            )
        )


def levels_of(mosaic: Mosaic) -> FloatArray:
    """The samples in parts of full scale, float32 (H, W)."""
    return mosaic.signal / np.float32(mosaic.calibration.full_scale)


def patch_samples(mosaic: Mosaic, regions: Sequence[Region]) -> PlaceSamples:
    """Statistics of the patches of a chart.

    Light may fall off across a patch, alike in all planes: a plane is fitted to the many panchromatic samples, and every plane is
    divided by it, so that samples at different sites can be compared.
    """
    levels, planes = levels_of(mosaic), mosaic.pattern.filter_map(mosaic.shape)
    rows = [_statistics(levels, planes, region, len(mosaic.pattern.planes)) for region in regions]
    mean, variance, count, clipped, centre = (np.array(column) for column in zip(*rows, strict=True))
    return PlaceSamples(mean, variance, count, clipped, centre)


def _statistics(
    levels: FloatArray, planes: np.ndarray, region: Region, number: int
) -> tuple[DoubleArray, DoubleArray, DoubleArray, bool, DoubleArray]:
    window = np.s_[region.top : region.top + region.mask.shape[0], region.left : region.left + region.mask.shape[1]]
    down, right = np.nonzero(region.mask)
    values = levels[window][region.mask].astype(np.float64)
    plane = planes[window][region.mask]
    centre = np.array([down.mean(), right.mean()])
    design = np.stack([np.ones(values.size), down - centre[0], right - centre[1]], axis=1)
    white = plane == number - 1
    fitted, *_ = np.linalg.lstsq(design[white], values[white], rcond=None)
    shading = design @ fitted / fitted[0] if fitted[0] > 0 else np.ones(values.size)
    shading = np.clip(shading, 0.5, 2.0)
    clipped = bool((values >= CLIPPED).any())
    mean, variance, count = np.zeros(number), np.zeros(number), np.zeros(number)
    for index in range(number):
        of_plane = plane == index
        mean[index], variance[index], count[index] = _robust(values[of_plane], shading[of_plane])
    return mean, variance, count, clipped, centre + np.array([region.top, region.left])


def _robust(values: DoubleArray, shading: DoubleArray) -> tuple[float, float, int]:
    """Mean at shading 1, variance, and count of the samples that belong together."""
    if values.size < 2:
        return (float(values.sum()), 0.0, values.size)
    residual = values - np.median(values / shading) * shading
    spread = _MAD * np.median(np.abs(residual))
    # Of a handful of samples the spread itself is a guess: better keep them all.
    if values.size >= 9 and spread > 0:
        kept = np.abs(residual) <= _OUTLIER * spread
        values, shading = values[kept], shading[kept]
    mean = float(values.sum() / shading.sum())  # maximum likelihood for photons
    variance = float(((values - mean * shading) ** 2).sum() / max(values.size - 1, 1))
    return mean, variance, values.size
