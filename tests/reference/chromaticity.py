"""Eqs. 6-9: one chromaticity per whole block, and the oriented medians at the end of section
3.2.
"""

import numpy as np

from panchroma.shared import CfaPattern, DoubleArray
from tests.reference.geometry import block_sites, is_whole, patch_counts, whole_blocks

ORIENTATIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


def solve_block(
    samples: list[list[float]], luminance: list[list[float]], gamma: tuple[float, ...], sigma: float
) -> DoubleArray:
    """The minimiser of Eqs. 8-9 subject to sum_i gamma_i c_i = 1, from its Lagrange equations.

    samples, luminance: per channel, the values at its sites.
    """
    count = len(gamma)
    grey = 1 / sum(gamma)
    equations, right = np.zeros((count + 1, count + 1)), np.zeros(count + 1)
    for i in range(count):
        equations[i, i] = sum(light**2 for light in luminance[i]) + sigma**2
        equations[i, count] = equations[count, i] = gamma[i]
        pairs = zip(luminance[i], samples[i], strict=True)
        right[i] = sum(light * sample for light, sample in pairs) + sigma**2 * grey
    right[count] = 1.0
    return np.linalg.solve(equations, right)[:count].astype(np.float64)


def estimate(
    signal: DoubleArray,
    luminance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    sigma: float,
) -> DoubleArray:
    """Chromaticities of the whole blocks, before the medians, (rows, columns, C). A block without
    light is grey if sigma is 0.
    """

    def solved(index: tuple[int, int]) -> DoubleArray:
        samples, lights = [], []
        for channel in pattern.channels:
            sites = [site[:2] for site in block_sites(pattern, index) if site[2] == channel]
            samples.append([float(signal[site]) for site in sites])
            lights.append([float(luminance[site]) for site in sites])
        if sigma == 0 and not any(any(light) for light in lights):
            return np.full(len(gamma), 1 / sum(gamma))
        return solve_block(samples, lights, gamma, sigma)

    shape = (luminance.shape[0], luminance.shape[1])
    return np.array([list(map(solved, row)) for row in whole_blocks(pattern, shape)])


def proposals(coarse: DoubleArray, row: int, column: int) -> list[DoubleArray]:
    """The four 1-D medians of five through one block, channel by channel."""
    wide = np.pad(coarse, ((2, 2), (2, 2), (0, 0)), mode="reflect")
    steps = np.arange(5) - 2
    return [
        np.median(wide[row + 2 + steps * down, column + 2 + steps * right], axis=0)
        for down, right in ORIENTATIONS
    ]


def oriented_medians(
    coarse: DoubleArray, gamma: tuple[float, ...], repetitions: int
) -> DoubleArray:
    """Replace each vector by the nearest of its four medians until nothing changes, then scale it
    to sum_i gamma_i c_i = 1.

    coarse: (rows, columns, C), chromaticities of the whole blocks.
    gamma: the C weights of Eq. 7.
    repetitions: largest number of repetitions.
    """
    current = coarse
    for _ in range(repetitions):
        following: DoubleArray = np.empty_like(current)
        for place in np.ndindex(current.shape[:2]):
            medians = proposals(current, *place)
            distances = np.square(np.array(medians) - current[place]).sum(axis=1)
            following[place] = medians[int(np.argmin(distances))]
        if np.array_equal(following, current):
            break
        current = following
    return current / (current @ np.array(gamma))[..., None]


def extend(coarse: DoubleArray, pattern: CfaPattern, shape: tuple[int, int]) -> DoubleArray:
    """Chromaticities of all blocks of the grid: a block that is not whole takes those of the
    nearest whole one.
    """
    down, across = patch_counts(pattern, shape)
    whole = np.array(
        [[is_whole(pattern, shape, (i, j)) for j in range(across + 1)] for i in range(down + 1)]
    )
    # whole blocks fill a rectangle
    rows, columns = (np.flatnonzero(whole.any(axis=axis)) for axis in (1, 0))
    beyond = (rows[0], down - rows[-1]), (columns[0], across - columns[-1]), (0, 0)
    return np.pad(coarse, beyond, mode="edge")
