"""Which blocks vouch for their colour, block by block. Nothing is clipped here."""

from itertools import product

import numpy as np

from offline.stages import trust as constants
from shared import CfaPattern, NoiseModel
from shared.arrays import DoubleArray
from tests.reference.gaussian import blur
from tests.reference.geometry import block, block_sites, is_whole, letter, patch_counts


def whole_blocks(pattern: CfaPattern, shape: tuple[int, int]) -> list[list[list[tuple[int, int, str]]]]:
    """The sites of every whole block, (rows, columns, S) of (row, column, letter)."""
    down, across = patch_counts(pattern, shape)
    rows = [[block_sites(pattern, (i, j)) for j in range(across + 1) if is_whole(pattern, shape, (i, j))] for i in range(down + 1)]
    return [row for row in rows if row]


def trust_in_blocks(
    signal: DoubleArray, pattern: CfaPattern, gamma: tuple[float, ...], noise: NoiseModel | None, agreement: float
) -> DoubleArray:
    """0 to 1 for each whole block, (rows, columns)."""
    totals, lights = [], []
    for row in whole_blocks(pattern, (signal.shape[0], signal.shape[1])):
        for sites in row:
            ring = ring_of(sites, pattern, (signal.shape[0], signal.shape[1]))
            means = []
            for y, x, _ in sites:
                weights = [1 / ((y - down) ** 2 + (x - right) ** 2) for down, right in ring]
                means.append(float(np.average([signal[place] for place in ring], weights=weights)) if ring else 0.0)
            lights.append(float(np.mean(means)))
            values = {name: [signal[y, x] for y, x, each in sites if each == name] for name in pattern.channels}
            totals.append(sum(weight * float(np.mean(values[name])) for weight, name in zip(gamma, pattern.channels, strict=True)))
    total, light = np.array(totals), np.array(lights)
    unsure = np.array([_noise(pattern, gamma, noise, each) for each in light]) if noise else 0.0
    width = agreement * np.maximum(light, 1e-9) + constants._NOISE * unsure
    rows = len(whole_blocks(pattern, (signal.shape[0], signal.shape[1])))
    return (1 / (1 + (np.abs(light - total) / width) ** 4)).reshape(rows, -1)


def ring_of(sites: list[tuple[int, int, str]], pattern: CfaPattern, shape: tuple[int, int]) -> list[tuple[int, int]]:
    """The panchromatic pixels in a block and next to it."""
    found, top, left = block(pattern), min(y for y, _, _ in sites), min(x for _, x, _ in sites)
    area = product(range(top - 1, top + found.height + 1), range(left - 1, left + found.width + 1))
    return [(y, x) for y, x in area if 0 <= y < shape[0] and 0 <= x < shape[1] and letter(pattern, y, x) == "W"]


def _noise(pattern: CfaPattern, gamma: tuple[float, ...], noise: NoiseModel, light: float) -> float:
    """Standard deviation of the noise of a block's sum less the light around it, if the block is grey."""
    found = block(pattern)
    area = product(range(-1, found.height + 1), range(-1, found.width + 1))
    names = [letter(pattern, found.top + down, found.left + right) for down, right in area]
    variance = noise.sigma(light) ** 2 / names.count("W")
    inside = [
        letter(pattern, found.top + down, found.left + right) for down, right in product(range(found.height), range(found.width))
    ]
    for plane, (weight, name) in enumerate(zip(gamma, pattern.channels, strict=True)):
        variance += weight**2 * noise.sigma(light / sum(gamma), plane) ** 2 / inside.count(name)
    return float(np.sqrt(variance))


def with_trusted_colour(coarse: DoubleArray, trust: DoubleArray, gamma: tuple[float, ...]) -> DoubleArray:
    """Chromaticities of the whole blocks, (rows, columns, C): without trust, the trusted mean around takes their place."""
    weight = np.maximum(blur(trust, constants._AROUND), 1e-9)
    around = np.stack([blur(trust * plane, constants._AROUND) / weight for plane in np.moveaxis(coarse, 2, 0)], axis=2)
    around /= (around @ np.array(gamma))[..., None]
    return trust[..., None] * coarse + (1 - trust[..., None]) * around
