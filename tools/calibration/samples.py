"""Means and variances of the mosaic's samples in places such as patches. They are measured values:
nothing is reconstructed.

Levels are parts of full scale: (code - black) / (white - black). Full scale is the same for all
planes, so Eq. 7 has the same gamma for levels as for scene units. That is why gamma can be measured
without knowing full scale in scene units.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from ...shared import CfaPattern, Mosaic
from ...shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray, IndexArray

CLIPPED = 0.985  # of full scale: above it some of the noise would be cut off
CLIP = 5.0  # standard deviations: samples beyond are left out when a deviation is measured
LEAST_SAMPLES = 40  # samples of the rarest plane in a tile, about
# per side, at most: flat frames are never quite even, so means and variances are measured in tiles
_TILES = 12
# standard deviations: dust, glints, hot pixels; one Gaussian sample in two million is beyond
_OUTLIER = 5.0


Pixels = tuple[IndexArray, IndexArray]
"""Rows and columns of the pixels of a place."""


@dataclass(frozen=True, eq=False)
class PlaceSamples:
    """Statistics of N places, per plane (the C channels, then panchromatic), in parts of full
    scale.

    Attributes
    ----------
    mean : DoubleArray
        (N, C + 1), level at the centre of the place.
    variance : DoubleArray
        (N, C + 1), of a single sample about the place's shading.
    count : DoubleArray
        (N, C + 1), number of samples.
    clipped : BoolArray
        (N,), whether a sample is at the white level.
    where : DoubleArray
        (N, 2), row and column from the middle of the frame, in halves of its diagonal.
    dimming : DoubleArray | float
        (N, C), how much more than panchromatic levels those of a channel fall off there, as a share
        of what known shading leaves of them: its gain of panchromatic samples over the channel's,
        minus 1.
    """

    mean: DoubleArray
    variance: DoubleArray
    count: DoubleArray
    clipped: BoolArray
    where: DoubleArray
    dimming: DoubleArray | float = 0.0


def levels_of(mosaic: Mosaic) -> FloatArray:
    """Return the samples in parts of full scale, without shading, float32 (H, W)."""
    return mosaic.signal / np.float32(mosaic.calibration.full_scale)


def without_shading(mosaic: Mosaic) -> Mosaic:
    """Return a frame that does not state the shading of its lens."""
    return replace(mosaic, calibration=replace(mosaic.calibration, shading=None))


def figures(values: Sequence[float] | DoubleArray) -> str:
    """Return numbers as text, with four digits each."""
    return " ".join(f"{value:.4g}" for value in values)


def robust_deviation(residuals: DoubleArray) -> float:
    """Return the standard deviation of residuals about 0 from their median absolute value; outliers
    hardly change it.
    """
    return 1.4826 * float(np.median(np.abs(residuals)))  # 1.4826: for a Gaussian


def planes_of(pattern: CfaPattern, shape: tuple[int, int]) -> ByteArray:
    """Return the plane of each sample, uint8 (H, W), as `CfaPattern.filter_map`; a channel without
    filters has every second panchromatic pixel of a row, because it is read by their electronics.
    """
    planes = pattern.filter_map(shape)
    if pattern.derived is not None:
        clear = planes == len(pattern.channels)
        planes[clear & (clear.cumsum(axis=1, dtype=np.uint8) % 2 == 1)] = pattern.derived
    return planes


def patch_samples(mosaic: Mosaic, patches: Sequence[Pixels]) -> PlaceSamples:
    """Return the statistics of the patches of a chart.

    The light may fall off across a patch, equally for all filters: a linear surface is fitted to
    the panchromatic samples, which are many, and all samples are divided by it, so that samples at
    different sites can be compared.
    """
    levels, pattern = levels_of(mosaic).astype(np.float64), mosaic.pattern
    planes, number = planes_of(pattern, mosaic.shape), len(pattern.planes)
    # What saturates is what the sensor reads.
    clipped = levels_of(without_shading(mosaic)) >= CLIPPED
    moments = [_moments(*pixels, levels[pixels], planes[pixels], number) for pixels in patches]
    mean, variance, count = np.moveaxis(np.array(moments), 1, 0)
    at_white = np.array([clipped[pixels].any() for pixels in patches])
    last, gain = np.array(mosaic.shape) - 1, np.ones(mean.shape)
    middles = np.array([(rows.mean(), columns.mean()) for rows, columns in patches])
    if shading := mosaic.calibration.shading:
        for place, (row, column) in zip(gain, middles.astype(int).tolist(), strict=True):
            part = slice(row, row + 1), slice(column, column + 1)
            place[:] = [
                shading.of_plane(mosaic.shape, plane, *part).item() for plane in range(number)
            ]
    where = 2 * (middles - last / 2) / np.hypot(*last)
    dimming = gain[:, -1:] / gain[:, :-1] - 1
    return PlaceSamples(mean, variance, count, at_white, where, dimming)


def _moments(
    rows: IndexArray, columns: IndexArray, values: DoubleArray, plane: np.ndarray, number: int
) -> DoubleArray:
    """Return mean, variance and count per plane, (3, number)."""
    design = np.stack([np.ones(values.size), rows - rows.mean(), columns - columns.mean()], axis=1)
    white = plane == number - 1
    fitted, *_ = np.linalg.lstsq(design[white], values[white], rcond=None)
    shading = np.ones(values.size)
    if fitted[0] > 0:
        shading = np.clip(design @ fitted / fitted[0], 0.5, 2.0)
    own = (plane == index for index in range(number))
    return np.array([_robust(values[here], shading[here]) for here in own], np.float64).T


def _robust(values: DoubleArray, shading: DoubleArray) -> tuple[float, float, int]:
    """Return mean at shading 1, variance, and number of the samples without outliers."""
    if values.size < 2:
        return (float(values.sum()), 0.0, values.size)
    residual = values - np.median(values / shading) * shading
    spread = robust_deviation(residual)
    # With few samples the spread itself is uncertain: keep them all.
    if values.size >= 9 and spread > 0:
        kept = np.abs(residual) <= _OUTLIER * spread
        values, shading = values[kept], shading[kept]
    mean = float(values.sum() / shading.sum())  # maximum likelihood for photons
    variance = float(((values - mean * shading) ** 2).sum() / max(values.size - 1, 1))
    return mean, variance, values.size


def tiles(planes: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Yield tiles of the frame, as many as possible with enough samples of every plane in each."""
    rarest = int(np.bincount(planes.ravel()).min())
    number = int(np.clip(np.sqrt(rarest / LEAST_SAMPLES), 1, _TILES))
    yield from windows(planes.shape, (number, number))


def windows(shape: tuple[int, ...], numbers: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """Yield the windows that cut a frame into rows and columns of them.

    Parameters
    ----------
    numbers : tuple[int, ...]
        Of windows along each axis.
    """
    cuts = (
        np.unique(np.linspace(0, length, number + 1).astype(int)).tolist()
        for length, number in zip(shape, numbers, strict=True)
    )
    for (top, bottom), (left, right) in product(*map(pairwise, cuts)):
        yield slice(top, bottom), slice(left, right)


def clipped_moments(values: DoubleArray) -> tuple[float, float]:
    """Return mean and standard deviation without outliers, which are clipped until nothing changes.

    Do not use the median deviation: it is 0 or 1 for integer codes with little noise.
    """
    from scipy.stats import sigmaclip  # scipy.stats takes a second to load

    kept = sigmaclip(values, CLIP, CLIP).clipped
    if not kept.size:  # all are equal, but for the rounding of their mean
        kept = values
    return float(kept.mean()), float(kept.std())
