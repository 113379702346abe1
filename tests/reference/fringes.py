"""Displaced channels, sample by sample in float64: how far they are, samples without it, and pictures with it."""

import math

import numpy as np

from offline.kernels import fringes as kernels
from offline.whole import fringes as constants
from shared import CfaPattern, NoiseModel
from shared.arrays import DoubleArray
from tests.reference.gaussian import blur
from tests.reference.geometry import keys
from tests.reference.pooling import curvature
from tests.reference.sites import at_sites, whole_blocks

SLOPE = 1e-5  # pixels: to either side, for slopes of an interpolation


def seen(plane: DoubleArray, shift: DoubleArray, y: float, x: float) -> float:
    """What a channel that is displaced by (down, across, outwards) shows at a place."""
    height, width = plane.shape
    diagonal = math.hypot(height - 1, width - 1)
    out_y, out_x = (2 * y - (height - 1)) / diagonal, (2 * x - (width - 1)) / diagonal
    return float(keys(plane, y + shift[0] + shift[2] * out_y, x + shift[1] + shift[2] * out_x))


def about_colour(
    signal: DoubleArray, luminance: DoubleArray, pattern: CfaPattern, gamma: tuple[float, ...], dark: float
) -> DoubleArray:
    """About the chromaticity of each whole block, (rows, columns, C)."""
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))
    shares, names = at_sites(signal, blocks) / np.maximum(at_sites(luminance, blocks), dark), [name for *_, name in blocks[0][0]]
    means = [shares[..., [name == channel for name in names]].mean(axis=2) for channel in pattern.channels]
    smooth = np.stack([np.maximum(blur(mean, constants._BLUR), constants._LEAST) for mean in means], axis=2)
    return np.asarray(smooth / (smooth @ np.array(gamma))[..., None])


def without(
    signal: DoubleArray,
    luminance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    colour: DoubleArray,
    shifts: DoubleArray,
) -> DoubleArray:
    """The samples as if no channel were displaced, (H, W). colour: of each block. shifts: (C, 3)."""
    result = signal.copy()
    for row, line in enumerate(whole_blocks(pattern, (signal.shape[0], signal.shape[1]))):
        for column, sites in enumerate(line):
            for y, x, name in sites:
                lights = [seen(luminance, shift, y, x) for shift in shifts]
                whole = sum(weight * share * light for weight, share, light in zip(gamma, colour[row, column], lights, strict=True))
                own = lights[pattern.channels.index(name)]
                if own > 0 and whole > 0:
                    result[y, x] *= min(max(whole / own, 1 / kernels.MOST), kernels.MOST)
    return result


def displaced(luminance: DoubleArray, chromaticity: DoubleArray, gamma: tuple[float, ...], shifts: DoubleArray) -> DoubleArray:
    """The chromaticity of a picture whose channels are displaced, (H, W, C), where all of it is positive."""
    result = np.empty_like(chromaticity)
    for y, x in np.ndindex(*luminance.shape):
        for channel, shift in enumerate(shifts):
            before = chromaticity[y, x, channel]
            moved = seen(luminance * chromaticity[..., channel], shift, y, x) / luminance[y, x]
            change = min(max(moved / before, 1 / kernels.MOST), kernels.MOST) - 1
            result[y, x, channel] = before * (1 + change * change**2 / (change**2 + kernels._FAINT**2))
        result[y, x] /= result[y, x] @ np.array(gamma)
    return result


def find(
    signal: DoubleArray, luminance: DoubleArray, pattern: CfaPattern, gamma: tuple[float, ...], noise: NoiseModel | None
) -> DoubleArray | None:
    """How far the channels are displaced, (C, 3), as far as it is believed. Nothing is clipped, and all blocks are looked at."""
    count = len(gamma)
    level = float(signal[pattern.panchromatic_mask((signal.shape[0], signal.shape[1]))].mean())
    dark = max(constants._DARK * level, 3 * noise.sigma(0.0) if noise else 0.0)
    colour = about_colour(signal, luminance, pattern, gamma, dark)
    expected = np.array([constants._SHIFT, constants._SHIFT, constants._OUTWARD] * count + [constants._FLAT] * 2)
    prior = np.diag(expected**-2)
    for axis in range(3):
        together = np.zeros(len(expected))
        together[axis : 3 * count : 3] = np.array(gamma) * colour.mean(axis=(0, 1)) / constants._STILL
        prior += np.outer(together, together)
    unknowns = np.zeros(len(expected))
    without = _equations(signal, luminance, pattern, gamma, noise, colour, unknowns, dark)
    for _ in range(constants._ROUNDS):
        tiles = _equations(signal, luminance, pattern, gamma, noise, colour, unknowns, dark)
        normal, right = sum(tile[0] for tile in tiles) + prior, sum(tile[2] for tile in tiles) - prior @ unknowns
        step = np.linalg.solve(normal, right)
        unknowns = unknowns + step
        if np.abs(step).max() < constants._STEP:
            break
    if len(tiles) <= len(expected):
        return None
    whole = sum(tile[1] for tile in tiles) + prior
    changes = [np.linalg.solve(whole - steep, right) for _, steep, right in tiles]
    covariance = len(tiles) / (len(tiles) - len(expected)) * sum(np.outer(change, change) for change in changes)
    covariance = covariance + np.linalg.inv(whole) @ prior @ np.linalg.inv(whole)
    shifts, apart = unknowns[:-2], covariance[:-2, :-2] + constants._UNSURE**2 * np.eye(3 * count)
    gains = [right[:-2] @ shifts - shifts @ steep[:-2, :-2] @ shifts / 2 for _, steep, right in without]
    gained = sum(gains) / math.sqrt(sum(gain**2 for gain in gains) * min(len(gains), constants._MANY))
    far = math.sqrt(shifts @ np.linalg.inv(apart) @ shifts)
    share = min(np.interp(far, constants._BELIEVED, (0, 1)), np.interp(gained, constants._GAINS, (0, 1)))
    return share * shifts.reshape(-1, 3) if share else None


def _equations(
    signal: DoubleArray,
    luminance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    noise: NoiseModel | None,
    colour: DoubleArray,
    unknowns: DoubleArray,
    dark: float,
) -> list[tuple[DoubleArray, DoubleArray, DoubleArray]]:
    """Of each tile: the weighted equations, how `right` changes, and `right`."""
    blocks = whole_blocks(pattern, (signal.shape[0], signal.shape[1]))
    found = {}
    for row, line in enumerate(blocks):
        for column, sites in enumerate(line):
            for site in range(len(sites)):
                given = signal, luminance, pattern, gamma, noise, colour[row, column], sites, site, unknowns, dark
                found[row, column, site] = _explained(*given)
    size, tiles = len(unknowns), dict[tuple[int, int], list[DoubleArray]]()
    for (row, column, site), (value, known, variance) in found.items():
        place = row // constants._SIDE, column // constants._SIDE
        sums = tiles.setdefault(place, [np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)])
        for down, right in (0, 1), (1, 0):
            other = found.get((row + down, column + right, site))
            if other is None:
                continue
            apart, change, spread = value - other[0], known - other[1], variance + other[2]
            far = apart**2 / (spread * constants._SCALE**2)
            weight = 1 / (spread * math.sqrt(1 + far))
            sums[0] += weight * np.outer(change, change)
            sums[1] += weight / (1 + far) * np.outer(change, change)
            sums[2] += weight * apart * change
    return [(normal, steep, right) for normal, steep, right in tiles.values()]


def _explained(
    signal: DoubleArray,
    luminance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    noise: NoiseModel | None,
    shares: DoubleArray,
    sites: list[tuple[int, int, str]],
    site: int,
    unknowns: DoubleArray,
    dark: float,
) -> tuple[float, DoubleArray, float]:
    """What a sample says its chromaticity is; how that changes with the unknowns, by differences; and its variance by chance."""
    (y, x, name), count = sites[site], len(gamma)
    channel, middle = pattern.channels.index(name), np.mean([place[:2] for place in sites], axis=0)

    def chromaticity(shifts: DoubleArray) -> float:
        lights = [seen(luminance, shift, y, x) for shift in shifts.reshape(-1, 3)]
        whole = max(sum(weight * share * light for weight, share, light in zip(gamma, shares, lights, strict=True)), dark)
        return float(whole / max(lights[channel], dark))  # falls where the channel sees more

    now = unknowns[:-2]
    before = chromaticity(now)
    known = np.zeros(len(unknowns))
    for each in range(3 * count):
        step = SLOPE * np.eye(3 * count)[each]
        known[each] = -shares[channel] * (chromaticity(now + step) - chromaticity(now - step)) / (2 * SLOPE) / before
    shift = now.reshape(-1, 3)[channel]
    own = max(seen(luminance, shift, y, x), dark)
    for axis, step in enumerate(((SLOPE, 0.0), (0.0, SLOPE))):
        ahead, behind = (seen(luminance, shift + sign * np.array([*step, 0.0]), y, x) for sign in (1, -1))
        known[3 * count + axis] = 2 * ((y, x)[axis] - middle[axis]) * shares[channel] * (ahead - behind) / (2 * SLOPE) / own
    value = signal[y, x] * before / max(luminance[y, x], dark) - unknowns[-2:] @ known[-2:]
    light = max(luminance[y, x], dark)
    variance = constants._EVEN**2 + (noise.sigma(signal[y, x], channel) ** 2 / light**2 if noise else 0.0)
    variance += (shares[channel] * constants._FILLED * curvature(luminance, (y, x), pattern) / light) ** 2
    return float(value), known, float(variance)
