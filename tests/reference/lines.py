"""Colour lines, block by block in float64: weighted least squares around each block, and what one is believed."""

from functools import cache
from itertools import product

import numpy as np

from offline.measured import EVEN
from offline.stages import colour_lines as constants
from offline.stages.correction import FILLED
from shared import CfaPattern, NoiseModel
from shared.arrays import DoubleArray
from tests.reference.gaussian import blur
from tests.reference.geometry import block, block_corner, is_whole, letter, patch_counts
from tests.reference.sites import at_sites, near, whole_blocks

Lines = tuple[DoubleArray, DoubleArray, DoubleArray]
"""Offset and slope of each channel in units of luminance, (rows, columns, C), and the share of each line, (rows, columns)."""


def colour_lines(
    signal: DoubleArray,
    luminance: DoubleArray,
    coarse: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    noise: NoiseModel | None,
) -> Lines:
    """The lines around all whole blocks. coarse: their estimated chromaticities, (rows, columns, C). Nothing is clipped."""
    blocks, weights, count = whole_blocks(pattern, (signal.shape[0], signal.shape[1])), np.array(gamma), len(gamma)
    shape, names = (len(blocks), len(blocks[0])), [name for _, _, name in blocks[0][0]]
    members = np.array([[float(name == channel) for name in names] for channel in pattern.channels])
    means = members / members.sum(axis=1, keepdims=True)
    light = (at_sites(luminance, blocks) @ means.T).reshape(-1, count)
    samples = at_sites(signal, blocks)
    seen = (samples @ means.T).reshape(-1, count) * weights
    level = float(signal[pattern.panchromatic_mask((signal.shape[0], signal.shape[1]))].mean())
    mean = np.maximum(light.mean(axis=1), constants._DARK * level)
    span = np.array([np.ptp([signal[place] for place in ring_of(sites, pattern, signal.shape)]) for row in blocks for sites in row])
    variance = np.zeros(len(mean))
    if noise is not None:
        span = np.maximum(span - constants._RANGE * np.array([noise.sigma(each) for each in mean]), 0)
        of_site = np.array([[noise.sigma(value, pattern.channels.index(name)) ** 2 for value, name in zip(each, names, strict=True)]
                            for each in samples.reshape(-1, len(names))])  # fmt: skip
        variance = (of_site @ (means**2).T * weights**2).mean(axis=1)
    strokes = (constants._STROKES * span / count / max(members.sum(axis=1).min() / constants._NEIGHBOURS, 1)) ** 2
    strokes += np.maximum((seen - light).max(axis=1) - constants._BEYOND * np.sqrt(count**2 * strokes + variance), 0) ** 2
    even = strokes + (EVEN * mean) ** 2
    rough = strokes + variance + (constants._LINEAR * mean / count) ** 2 + (constants._FAINT * level) ** 2

    around = _nearness(shape)
    offset, slope = np.zeros_like(seen), np.zeros_like(seen)
    for here in range(len(mean)):
        exact, weight = around[here] / (even + variance), around[here] / rough
        middle, through = np.average(light, axis=0, weights=exact), np.average(seen, axis=0, weights=exact)
        mixture, x, y = (through / middle) / (through / middle).sum(), light - middle, seen - through
        least = (constants._CONTRAST * middle.mean()) ** 2 + np.average(variance, weights=weight)
        spread = np.average(x**2, axis=0, weights=weight) + least
        steep = (np.average(x * y, axis=0, weights=weight) + least * mixture) / spread
        rest = np.maximum(np.average(y**2, axis=0, weights=weight) - steep * np.average(x * y, axis=0, weights=weight), 0)
        # The sum of squared weights, where a Gaussian squared is a narrower Gaussian.
        squares = (_nearness(shape, constants._WIDTH / np.sqrt(2))[here] / rough**2).sum() / (4 * np.pi * constants._WIDTH**2)
        whole = max(steep.sum(), constants._LEAST_SLOPE)
        odd = steep / whole - mixture
        odd -= odd.mean()
        rest += (EVEN * middle.mean()) ** 2
        error = (rest / spread).sum() * squares / weight.sum() ** 2 / whole**2
        if odd.any():
            odd *= max(1 - constants._DEVIATIONS**2 * error / (odd @ odd), 0)
        offset[here], slope[here] = -odd * middle.mean(), mixture + odd

    close, square = _nearness(shape, constants._CLOSE), mean**2 / (even + strokes + variance)
    rest = seen - offset - slope * light
    rest -= rest.mean(axis=1, keepdims=True)
    for here, each in enumerate(close):
        tint = (each * square / mean) @ rest / (each @ square)
        squares = _nearness(shape, constants._CLOSE / np.sqrt(2))[here] @ square / (4 * np.pi * constants._CLOSE**2)
        error = (count - 1) * squares / (each @ square) ** 2
        slope[here] += tint * max(1 - error / max(tint @ tint, 1e-30), 0)

    def apart(colours: DoubleArray) -> DoubleArray:
        return ((colours - colours.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)

    expected = even + strokes
    printed = around @ strokes / np.maximum(around @ strokes + constants._PRINT * variance, 1e-30)
    left = constants._LEFT * printed**2 * variance
    estimated = coarse.reshape(-1, count) * weights * mean[:, None] - offset - slope * mean[:, None]
    chi, sure = apart(estimated) / (expected + left), 1 / (expected + variance + (constants._DARK * level) ** 2)
    rest = seen - offset - slope * light
    power, common = apart(estimated), (estimated * (rest - rest.mean(axis=1, keepdims=True))).sum(axis=1)
    common += variance * (count - 1) / (4 * np.pi * constants._CLOSE**2)
    # The variance of a weighted mean: a Gaussian squared has the sum 1 / (4 pi width^2).
    unsure = constants._UNSURE * np.sqrt(around @ (sure * power) / (4 * np.pi * constants._WIDTH**2))
    confirmed = ((around @ (sure * common) + unsure) / np.maximum(around @ (sure * power), 1e-30)).clip(0, 1)
    informed = around @ ((expected / (expected + (count - 1) * variance)) ** 2)
    limit = constants._ESTIMATED * (1 + constants._UNTOLD * (1 - informed**2))
    share = 1 / (1 + (around @ chi.clip(None, constants._WORST) * confirmed**constants._CONFIRMED / limit) ** 6)
    aside = apart(rest) / (apart(rest) + (count - 1) * (expected + variance))
    share /= 1 + (mean / (around @ mean) * aside / constants._BRIGHT) ** 6
    offset, slope = with_inks(
        pattern, blocks[0][0], shape, (light, seen), (offset, slope), (mean, strokes, even + strokes + variance, rough)
    )
    return offset.reshape(*shape, count), slope.reshape(*shape, count), share.reshape(shape)


def with_inks(
    pattern: CfaPattern,
    sites: list[tuple[int, int, str]],
    shape: tuple[int, int],
    blocks: tuple[DoubleArray, DoubleArray],
    line: tuple[DoubleArray, DoubleArray],
    known: tuple[DoubleArray, DoubleArray, DoubleArray, DoubleArray],
) -> tuple[DoubleArray, DoubleArray]:
    """Offset and slope of each block's line, (blocks, C), with the ink of the nearest blocks as far as this explains more.

    sites: of a block. shape: how many blocks there are. blocks: light and share of each channel in it, (blocks, C).
    line: offset and slope before.
    known: mean light, and variances: of a channel for strokes, for all that is expected, and where a line departs too, (blocks,).
    """
    (light, seen), (offset, slope), (mean, strokes, expected, rough) = blocks, line, known
    count, close = seen.shape[1], _nearness(shape, constants._INK)
    rest = seen - offset - slope * light
    rest -= rest.mean(axis=1, keepdims=True)
    bright, light_mean = np.zeros(len(mean)), light.mean(axis=1)
    for here, each in enumerate(close):
        weight = each / expected
        bright[here] = weight @ light_mean**2 / (weight @ light_mean)
    darker, tint = light_mean - bright, np.zeros_like(rest)
    for _ in range(constants._ROUNDS):
        left = ((rest - tint * darker[:, None]) ** 2).sum(axis=1)
        sure = 1 / (expected + left / constants._FREEDOM + (constants._INKS * darker) ** 2)
        prior = 1 / (4 * np.pi * constants._INK**2 * constants._INKS**2)
        tint = np.stack([(each * sure * darker) @ rest / ((each * sure) @ darker**2 + prior) for each in close])

    members = np.array([[float(name == channel) for *_, name in sites] for channel in pattern.channels])
    nearby = members @ near(sites, FILLED) @ members.T
    correlation = nearby / np.sqrt(np.outer(np.diag(nearby), np.diag(nearby)))

    def likelihood(offset: DoubleArray, slope: DoubleArray) -> DoubleArray:
        found = np.zeros(len(mean))
        for here in range(len(mean)):
            deviation = np.sqrt(slope[here] ** 2 * strokes[here] * count**2 + rough[here] - strokes[here])
            covariance = correlation * np.outer(deviation, deviation)
            error = seen[here] - offset[here] - slope[here] * light[here]
            chi = error @ np.linalg.solve(covariance, error)
            found[here] = -np.linalg.slogdet(covariance)[1] / 2
            found[here] -= (constants._FREEDOM + count) / 2 * np.log(1 + chi / constants._FREEDOM)
        return found

    gain = likelihood(offset - tint * bright[:, None], slope + tint) - likelihood(offset, slope)
    agreed = np.maximum(np.minimum(close @ gain, _nearness(shape) @ gain), 1e-9)
    tint *= (1 / (1 + (constants._GAIN / agreed) ** constants._SURE))[:, None]
    return offset - tint * bright[:, None], slope + tint


def on_lines(
    light: DoubleArray, chromaticity: DoubleArray, lines: Lines, pattern: CfaPattern, gamma: tuple[float, ...]
) -> DoubleArray:
    """Chromaticity of every pixel, (H, W, C), taken to the lines as far as they are believed."""
    offset, slope, share = lines
    shape, weights = (light.shape[0], light.shape[1]), np.array(gamma)
    down, across = patch_counts(pattern, shape)
    first = next((i, j) for i in range(down + 1) for j in range(across + 1) if is_whole(pattern, shape, (i, j)))
    middle = np.array(block_corner(pattern, first)) + (np.array(pattern.block_shape) - 1) / 2
    result = chromaticity.copy()
    for y, x in np.ndindex(*shape):
        place = (np.array([y, x]) - middle) / pattern.period
        believed = _between(share, place)
        line = _between(share[..., None] * offset, place) + light[y, x] * _between(share[..., None] * slope, place)
        colour = np.maximum(line, 0)
        if believed > 1e-3 and colour.sum() > believed * light[y, x] / 2:
            apart = colour / colour.sum() / weights - chromaticity[y, x]
            result[y, x] += believed * max(1 - EVEN**2 / max(((weights * apart) ** 2).sum(), 1e-30), 0) * apart
    return result


def _between(values: DoubleArray, place: DoubleArray) -> DoubleArray:
    """Bilinear interpolation of (rows, columns, ...), constant beyond the outermost values."""
    for step in place:
        at = min(max(step, 0), len(values) - 1)
        low = int(at)
        high = min(low + 1, len(values) - 1)
        values = (1 - at + low) * values[low] + (at - low) * values[high]
    return values


@cache
def _nearness(shape: tuple[int, int], width: float = constants._WIDTH) -> DoubleArray:
    """The weight of every block around every other, (blocks, blocks): the frame is mirrored."""
    blocks = shape[0] * shape[1]
    columns = [blur(each.reshape(shape), width).ravel() for each in np.eye(blocks)]
    return np.stack(columns, axis=1)


def ring_of(sites: list[tuple[int, int, str]], pattern: CfaPattern, shape: tuple[int, int]) -> list[tuple[int, int]]:
    """The panchromatic pixels in a block and next to it."""
    found, top, left = block(pattern), min(y for y, _, _ in sites), min(x for _, x, _ in sites)
    area = product(range(top - 1, top + found.height + 1), range(left - 1, left + found.width + 1))
    return [(y, x) for y, x in area if 0 <= y < shape[0] and 0 <= x < shape[1] and letter(pattern, y, x) == "W"]
