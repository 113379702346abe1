"""Errors at the colour sites, block by block, from the normal equations of the model in `offline.stages.correction`."""

import math
from functools import cache
from itertools import product

import numpy as np

from offline.measured import EVEN
from offline.stages import correction as constants
from shared import CfaPattern, NoiseModel, site_errors
from shared.arrays import DoubleArray
from tests.reference.gaussian import blur
from tests.reference.geometry import block, block_sites, is_whole, mirrored, patch_counts


@cache
def whole_blocks(pattern: CfaPattern, shape: tuple[int, int]) -> list[list[list[tuple[int, int, str]]]]:
    """The sites of every whole block, (rows, columns, S) of (row, column, letter)."""
    down, across = patch_counts(pattern, shape)
    rows = [[block_sites(pattern, (i, j)) for j in range(across + 1) if is_whole(pattern, shape, (i, j))] for i in range(down + 1)]
    return [row for row in rows if row]


def near(sites: list[tuple[int, int, str]], correlation: float) -> DoubleArray:
    """The correlation of errors between two sites."""
    return np.array([[correlation ** math.dist(one[:2], other[:2]) for other in sites] for one in sites])


def noise_of(signal: DoubleArray, pattern: CfaPattern, noise: NoiseModel | None) -> DoubleArray:
    """Variance of the noise at each site of the whole blocks, (rows, columns, S)."""
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))

    def variance(y: int, x: int, name: str) -> float:
        return noise.sigma(max(signal[y, x], 0), pattern.channels.index(name)) ** 2 if noise else 0.0

    return np.array([[[variance(*site) for site in sites] for sites in row] for row in blocks])


def signal_power(error: DoubleArray, variance: DoubleArray) -> DoubleArray:
    """Mean square of the errors around each block beyond the noise. error: (rows, columns, S). variance: (rows, columns)."""
    return np.maximum(blur((error**2).mean(axis=2), constants._WIDTH) - constants._DEVIATIONS * variance, 0)


def fill_errors(luminance: DoubleArray, pattern: CfaPattern) -> DoubleArray:
    """Standard deviation of the error of filled luminance of the whole blocks, (rows, columns)."""
    blocks = whole_blocks(pattern, (luminance.shape[0], luminance.shape[1]))
    bends = np.array([[[curvature(luminance, (y, x), pattern) for y, x, _ in sites] for sites in row] for row in blocks])
    return constants._CURVED * np.sqrt((bends**2).mean(axis=2))


def most_probable(
    error: DoubleArray,
    colour: DoubleArray,
    fill_error: DoubleArray,
    variance: DoubleArray,
    blocks: list[list[list[tuple[int, int, str]]]],
    pattern: CfaPattern,
    believed: DoubleArray | None = None,
) -> tuple[DoubleArray, DoubleArray]:
    """Errors of luminance, (rows, columns, S), and of colour, (rows, columns, S, C), given the errors of the samples.

    believed: share of the colour line around each block, (rows, columns).

    All in units of luminance. The errors are one Gaussian vector: luminance at each site, then every channel at each site.
    """
    count, sites = len(pattern.channels), error.shape[2]
    index = [pattern.channels.index(name) for _, _, name in blocks[0][0]]
    power = signal_power(error, variance.mean(axis=2))
    light, tints = np.zeros(error.shape), np.zeros((*error.shape, count))
    aside = np.eye(count) - 1 / count  # takes luminance out of a colour
    for place in product(range(len(blocks)), range(len(blocks[0]))):
        if power[place] == 0:
            continue
        share = np.mean(colour[place] ** 2)
        bright = min(fill_error[place] ** 2, power[place] / max(share, constants._LEAST_SHARE))
        odd = max(power[place] - bright * share, constants._TINT * power[place]) / (1 - 1 / count)
        if believed is not None:
            bright += believed[place] * (power[place] / max(share, constants._LEAST_SHARE) - bright)
            odd *= max(1 - believed[place], constants._DOUBT)
        r = near(blocks[place[0]][place[1]], site_errors._NEAR)
        prior = np.zeros((sites + sites * count,) * 2)
        prior[:sites, :sites] = bright * r
        prior[sites:, sites:] = odd * np.kron(r, aside)
        seen = np.zeros((sites, len(prior)))
        for site, channel in enumerate(index):
            seen[site, site] = max(colour[place][site], 0)
            seen[site, sites + site * count + channel] = 1
        covariance = seen @ prior @ seen.T + np.diag(variance[place] + 1e-6 * (bright + odd))
        found = prior @ seen.T @ np.linalg.solve(covariance, error[place])
        light[place], tints[place] = found[:sites], found[sites:].reshape(sites, count)
    return light, tints


def settle(
    luminance: DoubleArray,
    coarse: DoubleArray,
    signal: DoubleArray,
    variance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    lines: tuple[DoubleArray, DoubleArray, DoubleArray] | None = None,
) -> DoubleArray:
    """Luminance, (H, W), with its most probable errors at the colour sites taken off.

    coarse: final chromaticities of the whole blocks, (rows, columns, C).
    variance: of the noise at each site, (rows, columns, S).
    lines: colour lines, see `tests.reference.lines`.
    """
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))
    index = [pattern.channels.index(name) for _, _, name in blocks[0][0]]
    weight = np.array(gamma)[index]
    colour = coarse[..., index] * weight
    light, samples = at_sites(luminance, blocks), at_sites(signal, blocks)
    shown, share = colour * light, None
    if lines is not None:
        share, line = lines[2], lines[0][..., index] + lines[1][..., index] * light
        far = np.maximum(((line - shown) ** 2).mean(axis=2), 1e-30)
        believed = (share * np.maximum(1 - EVEN**2 * (light**2).mean(axis=2) / far, 0))[..., None]
        shown = (1 - believed) * shown + believed * line
        colour = (1 - believed) * colour + believed * lines[1][..., index]
    error = samples * weight - shown
    delta, _ = most_probable(error, colour, fill_errors(luminance, pattern), variance * weight**2, blocks, pattern, share)
    settled = luminance.copy()
    for row, values in zip(blocks, delta, strict=True):
        for sites, each in zip(row, values, strict=True):
            for (y, x, _), value in zip(sites, each, strict=True):
                settled[y, x] += value
    return settled


def at_sites(plane: DoubleArray, blocks: list[list[list[tuple[int, int, str]]]]) -> DoubleArray:
    """The values of (H, W, ...) at the sites of the blocks, (rows, columns, S, ...)."""
    return np.array([[[plane[y, x] for y, x, _ in sites] for sites in row] for row in blocks])


def correct(
    luminance: DoubleArray,
    chromaticity: DoubleArray,
    signal: DoubleArray,
    fill_error: DoubleArray,
    variance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    believed: DoubleArray | None = None,
) -> DoubleArray:
    """The picture, (H, W, C), with what it misses at the sites of each block shared out among all channels there."""
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))
    index = [pattern.channels.index(name) for _, _, name in blocks[0][0]]
    weights = np.array(gamma)
    rgb: DoubleArray = chromaticity * luminance[..., None]
    here = at_sites(chromaticity * weights, blocks)
    colour = np.stack([here[:, :, site, channel] for site, channel in enumerate(index)], axis=2)
    seen = np.stack([at_sites(rgb * weights, blocks)[:, :, site, channel] for site, channel in enumerate(index)], axis=2)
    error = at_sites(signal, blocks) * weights[index] - seen
    light, tints = most_probable(error, colour, fill_error, variance * weights[index] ** 2, blocks, pattern, believed)
    for row, column in product(range(len(blocks)), range(len(blocks[0]))):
        for site, (y, x, _) in enumerate(blocks[row][column]):
            after = luminance[y, x] + light[row, column, site]
            if min(luminance[y, x], after) > 1e-6:
                rgb[y, x] = chromaticity[y, x] * after + tints[row, column, site] / weights
    return rgb


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
