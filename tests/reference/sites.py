"""Errors at the colour sites, block by block, from the normal equations of the Gaussian model that `offline.sites` describes."""

import math
from itertools import product

import numpy as np

from offline import sites as constants
from shared import CfaPattern, NoiseModel, site_errors
from shared.arrays import DoubleArray
from tests.reference.gaussian import blur
from tests.reference.geometry import block_sites, is_whole, patch_counts
from tests.reference.pooling import curvature


def whole_blocks(pattern: CfaPattern, shape: tuple[int, int]) -> list[list[list[tuple[int, int, str]]]]:
    """The sites of every whole block, (rows, columns, S) of (row, column, letter)."""
    down, across = patch_counts(pattern, shape)
    rows = [[block_sites(pattern, (i, j)) for j in range(across + 1) if is_whole(pattern, shape, (i, j))] for i in range(down + 1)]
    return [row for row in rows if row]


def near(sites: list[tuple[int, int, str]], correlation: float) -> DoubleArray:
    """The correlation of errors between two sites."""
    return np.array([[correlation ** math.dist(one[:2], other[:2]) for other in sites] for one in sites])


def solve_jointly(
    coarse: DoubleArray,
    signal: DoubleArray,
    luminance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    sigma: float,
    mismatch: float,
) -> DoubleArray:
    """Chromaticities of the whole blocks, (rows, columns, C): generalised least squares with the constraint of Eq. 7.

    coarse: from Eqs. 8-9, (rows, columns, C).
    """
    weights, grey = np.array(gamma), 1 / sum(gamma)
    result = coarse.copy()
    for row, blocks in enumerate(whole_blocks(pattern, (signal.shape[0], signal.shape[1]))):
        for column, sites in enumerate(blocks):
            light = np.array([luminance[y, x] for y, x, _ in sites])
            samples = np.array([signal[y, x] for y, x, _ in sites])
            seen = np.array([[float(name == channel) for channel in pattern.channels] for _, _, name in sites])
            bends = [curvature(luminance, (y, x), pattern) for y, x, _ in sites]
            doubt = constants._DOUBT * math.sqrt(np.mean(np.square(bends)))
            if doubt == 0:
                continue
            for _ in range(constants._ROUNDS):
                colour = np.clip(seen @ result[row, column], 0.06 * grey, 3 * grey)
                covariance = doubt**2 * np.diag(colour) @ near(sites, constants._FILLED) @ np.diag(colour)
                covariance += (doubt**2 * mismatch * np.mean(colour**2) + sigma**2) * np.eye(len(sites))
                design = np.diag(light) @ seen
                inverse = np.linalg.inv(covariance)
                count = len(gamma)
                equations, right = np.zeros((count + 1, count + 1)), np.ones(count + 1)
                equations[:count, :count] = design.T @ inverse @ design + np.eye(count)
                equations[:count, count] = equations[count, :count] = weights
                right[:count] = design.T @ inverse @ samples + grey
                result[row, column] = np.linalg.solve(equations, right)[:count]
    return result


def noise_of(signal: DoubleArray, pattern: CfaPattern, noise: NoiseModel | None) -> DoubleArray:
    """Variance of the noise at each site of the whole blocks, (rows, columns, S)."""
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))

    def variance(y: int, x: int, name: str) -> float:
        return noise.sigma(max(signal[y, x], 0), pattern.channels.index(name)) ** 2 if noise else 0.0

    return np.array([[[variance(*site) for site in sites] for sites in row] for row in blocks])


def signal_power(error: DoubleArray, variance: DoubleArray, deviations: float) -> DoubleArray:
    """Mean square of the errors around each block beyond the noise. error: (rows, columns, S). variance: (rows, columns)."""
    power: DoubleArray = np.maximum(blur((error**2).mean(axis=2), constants._WIDTH) - deviations * variance, 0)
    return power


def settle(
    luminance: DoubleArray,
    coarse: DoubleArray,
    signal: DoubleArray,
    variance: DoubleArray,
    pattern: CfaPattern,
    mismatch: float,
    deviations: float,
) -> DoubleArray:
    """Luminance, (H, W), with its most probable errors at the colour sites taken off.

    coarse: final chromaticities of the whole blocks, (rows, columns, C).
    variance: of the noise at each site, (rows, columns, S).
    """
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))
    colour = np.array(
        [
            [[c[pattern.channels.index(name)] for _, _, name in sites] for sites, c in zip(*pair, strict=True)]
            for pair in zip(blocks, coarse, strict=True)
        ]
    )
    light, samples = (
        np.array([[[plane[y, x] for y, x, _ in sites] for sites in row] for row in blocks]) for plane in (luminance, signal)
    )
    error = samples - colour * light
    power = signal_power(error, variance.mean(axis=2), deviations)
    settled = luminance.copy()
    for row, column in product(range(len(blocks)), range(len(blocks[0]))):
        c, sites = np.maximum(colour[row, column], 0), blocks[row][column]
        if power[row, column] == 0 or not c.any():
            continue
        scale = power[row, column] / (np.mean(c**2) * (1 + mismatch))
        shared = scale * near(sites, constants._FILLED)
        covariance = np.diag(c) @ shared @ np.diag(c) + np.diag(scale * mismatch * np.mean(c**2) + variance[row, column])
        delta = shared @ np.diag(c) @ np.linalg.solve(covariance, error[row, column])
        for (y, x, _), value in zip(sites, delta, strict=True):
            settled[y, x] += value
    return settled


def correct(
    rgb: DoubleArray, signal: DoubleArray, variance: DoubleArray, pattern: CfaPattern, gamma: tuple[float, ...], deviations: float
) -> DoubleArray:
    """The picture, (H, W, C), with what it misses at the sites of each block shared out among all channels there."""
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))
    index = [pattern.channels.index(name) for _, _, name in blocks[0][0]]
    weight = np.array([gamma[channel] for channel in index])
    error = (
        np.array(
            [
                [[(signal[y, x] - rgb[y, x, pattern.channels.index(name)]) for y, x, name in sites] for sites in row]
                for row in blocks
            ]
        )
        * weight
    )
    noise = (variance * weight**2).mean(axis=2)
    power = signal_power(error, noise, deviations)
    channels = len(gamma)
    between = np.full((channels, channels), site_errors._CHANNELS)
    np.fill_diagonal(between, 1)
    result = rgb.copy()
    for row, column in product(range(len(blocks)), range(len(blocks[0]))):
        sites = blocks[row][column]
        every = power[row, column] * np.kron(near(sites, site_errors._NEAR), between)
        seen = np.array([site * channels + channel for site, channel in enumerate(index)])
        if power[row, column] == 0:
            continue
        covariance = every[np.ix_(seen, seen)] + noise[row, column] * np.eye(len(sites))
        share = (every[:, seen] @ np.linalg.solve(covariance, error[row, column])).reshape(len(sites), channels) / np.array(gamma)
        for (y, x, _), each in zip(sites, share, strict=True):
            before, after = (float(values @ np.array(gamma)) for values in (rgb[y, x], rgb[y, x] + each))
            if min(before, after) > 1e-6:
                result[y, x] += each
    return result
