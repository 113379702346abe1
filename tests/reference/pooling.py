"""Chromaticities from averages of the sums of Eqs. 8-9 over similar blocks, block by block."""

import math

import numpy as np

from shared import CfaPattern, NoiseModel
from shared.arrays import DoubleArray
from tests.reference.gaussian import blur
from tests.reference.geometry import block, block_sites, is_whole, mirrored, patch_counts


def statistics(
    signal: DoubleArray,
    luminance: DoubleArray,
    coarse: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    noise: NoiseModel,
    curvature_error: float,
) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """sum l^2 / v and sum l m / v per channel, and mean luminance, of whole blocks: (rows, columns, C) twice, (rows, columns).

    coarse: chromaticities through which errors of luminance are seen, (rows, columns, C).
    """
    grey = 1 / sum(gamma)
    seen = np.stack([blur(plane, 0.7) for plane in np.moveaxis(coarse, 2, 0)], axis=2).clip(0.06 * grey, 3 * grey)
    shape = (signal.shape[0], signal.shape[1])
    down, across = patch_counts(pattern, shape)
    rows = [i for i in range(down + 1) if any(is_whole(pattern, shape, (i, j)) for j in range(across + 1))]
    columns = [j for j in range(across + 1) if any(is_whole(pattern, shape, (i, j)) for i in range(down + 1))]
    weight = np.zeros((len(rows), len(columns), len(gamma)))
    product, light = np.zeros_like(weight), np.zeros(weight.shape[:2])
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            sites = block_sites(pattern, (row, column))
            for y, x, name in sites:
                channel, value = pattern.channels.index(name), luminance[y, x]
                variance = noise.sigma(value / sum(gamma), channel) ** 2
                variance += (curvature_error * curvature(luminance, (y, x), pattern) * seen[i, j, channel]) ** 2
                weight[i, j, channel] += value**2 / variance
                product[i, j, channel] += value * signal[y, x] / variance
            light[i, j] = np.mean([luminance[y, x] for y, x, _ in sites])
    return weight, product, light


def curvature(luminance: DoubleArray, place: tuple[int, int], pattern: CfaPattern) -> float:
    """How far a pixel is from the mean of the two pixels one block's size to either side; the larger of both axes.

    A block that is a whole tile counts as four pixels wide at most.
    """
    (y, x), (height, width) = place, luminance.shape
    found, here = block(pattern), luminance[place]
    down, across = (min(size, 4) if found.height == pattern.period else size for size in (found.height, found.width))
    above, below = (luminance[mirrored(y + step, height), x] for step in (-down, down))
    left, right = (luminance[y, mirrored(x + step, width)] for step in (-across, across))
    return float(max(abs((above + below) / 2 - here), abs((left + right) / 2 - here)))


def solve(
    weight: DoubleArray, product: DoubleArray, gamma: tuple[float, ...], expected: DoubleArray, precision: float
) -> DoubleArray:
    """Eqs. 8-9 for one block, in units of the noise, from the Lagrange equations; pulled towards what is expected."""
    count = len(gamma)
    equations, right = np.zeros((count + 1, count + 1)), np.ones(count + 1)
    for i in range(count):
        equations[i, i] = weight[i] + precision
        equations[i, count] = equations[count, i] = gamma[i]
        right[i] = product[i] + precision * expected[i]
    return np.linalg.solve(equations, right)[:count].astype(np.float64)


def pool(
    coarse: DoubleArray,
    sums: tuple[DoubleArray, DoubleArray, DoubleArray],
    gamma: tuple[float, ...],
    pattern: CfaPattern,
    passes: tuple[tuple[float, float, int], ...],
    light: float,
    noise: NoiseModel,
) -> DoubleArray:
    """Chromaticities after all passes of pooling, (rows, columns, C).

    coarse: chromaticities that the first pass compares, (rows, columns, C).
    sums: what `statistics` returns.
    passes: (blur, tolerance, radius) each; see `PoolingPass`.
    light: standard deviation of the Gaussian weight of log luminance. noise: of panchromatic samples too.
    """
    weight, product, luminance = sums
    count = np.bincount([channel for _, _, channel in pattern.sites])
    surer = (count / count.mean()) ** 0.5  # of squared differences
    own = variance = 1 / weight.mean(axis=2)
    unsure = np.array([[noise.sigma(value) for value in row] for row in luminance])
    brightness = np.log(np.maximum(luminance, 1e-3) + 3 * unsure)
    places = list(np.ndindex(*luminance.shape))
    around = [np.stack([blur(plane, 2.5) for plane in np.moveaxis(each, 2, 0)], axis=2) for each in (weight, product)]
    grey, expected = np.full(len(gamma), 1 / sum(gamma)), np.empty_like(coarse)
    for here in places:
        expected[here] = solve(around[0][here], around[1][here], gamma, grey, 1.0)
    for std, tolerance, radius in passes:
        smooth = np.stack([blur(plane, std) for plane in np.moveaxis(coarse, 2, 0)], axis=2) if std else coarse
        following, left = np.empty_like(coarse), np.empty_like(own)
        for here in places:
            weights, products = np.zeros(len(gamma)), np.zeros(len(gamma))
            for there in places:
                down, right = abs(there[0] - here[0]), abs(there[1] - here[1])
                if max(down, right) > radius:
                    continue
                alike = (surer * (smooth[there] - smooth[here]) ** 2).sum() / (2 * tolerance * (variance[there] + variance[here]))
                alike += (brightness[there] - brightness[here]) ** 2 / (2 * light**2)
                alike += (down**2 + right**2) / (2 * (radius / 1.5) ** 2)
                weights += math.exp(-alike) * weight[there]
                products += math.exp(-alike) * product[there]
            following[here] = solve(weights, products, gamma, expected[here], (sum(gamma) / 0.42) ** 2)
            left[here] = 0.02 * own[here] + 1 / weights.mean()
        coarse, variance = following, left
    return coarse
