"""Chromaticity from the pooled statistics of many blocks that look alike, where one block alone is too noisy.

The sums of Eqs. 8-9, A_i and sum l m, hold all that a block knows of its chromaticity, each sample weighted by its precision. So
they are averaged, not the chromaticities: a dark block adds little to its neighbours and gains much from them, and so does a block
on an edge, whose luminance is filled in and uncertain.
"""

import numpy as np

from shared.arrays import BORDER, FloatArray, strips
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.pattern import BlockGrid
from shared.progress import SILENT, Progress

from .chromaticity import block_sites, solve_constrained
from .kernels.pooling import SLACK, pool
from .refinement import gaussian
from .settings import PoolingSettings

_LEAST_VARIANCE = 1e-12  # of a sample, scene units squared: a sensor without read noise has some in the dark, too
_LEAST_PRECISION = 1e-6  # of a chromaticity
_LEAST_LIGHT = 1e-3  # scene units: below it all is equally dark
_NEAR = 1.5  # the window's radius, in standard deviations of the weight by distance


def pool_blocks(
    blocks: FloatArray,
    mosaic: Mosaic,
    luminance: FloatArray,
    noise: NoiseModel | None,
    settings: PoolingSettings,
    progress: Progress = SILENT,
) -> FloatArray:
    """c_j of every block, float32 (block rows, block columns, C), sum_i gamma_i c_i = 1; `blocks` itself where there is no noise.

    blocks: of `estimate_chromaticities`: what looks alike at first; luminance: (H, W), denoised, scene units; noise: of the mosaic;
    None: unknown, and taken for none.
    """
    if not settings.passes or noise is None or not any(noise.shot[:-1] + noise.read[:-1]):
        return blocks
    progress.stage("pooling", len(settings.passes))
    grid = mosaic.pattern.grid(mosaic.shape)
    sums, light = precise_sums(mosaic, luminance, noise, grid, settings.doubt)
    channels, (rows, columns) = len(sums) // 2, light.shape
    variance = 1 / sums[:channels].mean(axis=0).clip(_LEAST_PRECISION)
    brightness = np.log(light.clip(_LEAST_LIGHT))
    chromaticity = blocks[grid.inside].reshape(rows, columns, channels).transpose(2, 0, 1)
    for blur, tolerance, radius in settings.passes:
        apart = np.arange(radius + 1) * (_NEAR / radius)
        near = np.exp(-(apart[:, None] ** 2 + apart**2) / 2).astype(np.float32)
        looks = np.stack([*_blurred(chromaticity, blur), (2 * tolerance) * variance, brightness])
        pooled = np.empty((len(sums), rows, columns + SLACK), np.float32)
        falloff = np.float32(-0.5 / settings.light**2)
        pool(_framed(sums, radius, 0), _framed(looks, radius, 1), radius, near, falloff, pooled)
        chromaticity = _solved(pooled[..., :columns], np.array(mosaic.calibration.gamma))
        progress.advance()
    return grid.extend(chromaticity.transpose(1, 2, 0))


def precise_sums(
    mosaic: Mosaic, luminance: FloatArray, noise: NoiseModel, grid: BlockGrid, doubt: float
) -> tuple[FloatArray, FloatArray]:
    """Of each whole block the sums of Eqs. 8-9, float32 (2 C + 1, rows, columns), and its luminance, (rows, columns).

    Every term is divided by the variance of what is wrong with it, if the block is grey: noise of the sample, and an error of the
    luminance of `doubt` times its curvature. First sum l^2 per channel, then sum l m, then 1.
    """
    shape, channels = (len(grid.whole_rows), len(grid.whole_columns)), len(mosaic.pattern.channels)
    sums, light = np.zeros((2 * channels + 1, *shape), np.float32), np.zeros(shape, np.float32)
    sites = block_sites(mosaic.pattern, grid)
    for channel, *site in sites:
        value = luminance[*site]
        grey = np.float32(mosaic.calibration.grey)
        variance = noise.shot[channel] * grey * value.clip(0) + noise.read[channel] ** 2
        variance += (np.float32(doubt) * grey * _curvature(luminance, site, grid.block_shape)) ** 2
        precision = 1 / np.maximum(variance, _LEAST_VARIANCE)
        sums[channel] += value**2 * precision
        sums[channels + channel] += value * mosaic.signal[*site] * precision
        light += value / len(sites)
    sums[-1] = 1
    return sums, light


def _curvature(luminance: FloatArray, site: list[slice], block: tuple[int, int]) -> FloatArray:
    """How far luminance at a site is from the mean of the two at either side, a block's size away; the worse of two directions."""
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


def _solved(pooled: FloatArray, gamma: np.ndarray) -> FloatArray:
    """Chromaticities, float32 (C, rows, columns), of weighted means: Eqs. 8-9, with sigma_z in the units of the sums, 1."""
    found = np.empty((len(gamma), *pooled.shape[1:]), np.float32)
    for rows in strips(pooled.shape[1]):
        means = (pooled[:-1, rows] / pooled[-1, rows]).astype(np.float64).transpose(1, 2, 0)
        weight, product = means[..., : len(gamma)], means[..., len(gamma) :]
        found[:, rows] = solve_constrained(weight, product, 1.0, gamma).transpose(2, 0, 1)
    return found


def _blurred(planes: FloatArray, sigma: float) -> FloatArray:
    """Every plane of (C, rows, columns) under a Gaussian, mirrored at its border."""
    if sigma == 0:
        return planes
    taps = gaussian(sigma)
    reach = len(taps) // 2
    for axis in (1, 2):
        border = [(reach, reach) if each == axis else (0, 0) for each in range(3)]
        wide, size = np.pad(planes, border, mode=BORDER), planes.shape[axis]
        planes = np.zeros_like(planes)
        for start, tap in enumerate(taps):
            planes += tap * (wide[:, start : start + size] if axis == 1 else wide[:, :, start : start + size])
    return planes


def _framed(planes: FloatArray, radius: int, value: float) -> FloatArray:
    """With as much of one value around as a window sees."""
    return np.pad(planes, ((0, 0), (radius, radius), (radius, radius + SLACK)), constant_values=np.float32(value))
