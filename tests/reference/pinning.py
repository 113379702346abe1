"""Colour pinned at scattered sites: each channel's field is the exact minimum of a sum of squares over the whole frame."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from offline.stages import pinning as constants
from shared import CfaPattern
from shared.arrays import DoubleArray
from tests.reference import sites
from tests.reference.gaussian import blur
from tests.reference.geometry import block_corner, keys


def pin(
    luminance: DoubleArray,
    chromaticity: DoubleArray,
    blocks: DoubleArray,
    signal: DoubleArray,
    variance: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    believed: DoubleArray,
) -> DoubleArray:
    """Chromaticity of every pixel, (H, W, C).

    blocks: of every tile of the grid, (rows, columns, C).
    variance: of the noise at the sites of the whole tiles, (rows, columns, S).
    believed: share of the colour line around each of these, (rows, columns).
    """
    shape = luminance.shape[0], luminance.shape[1]
    whole, weights = sites.whole_blocks(pattern, shape), np.array(gamma)
    index = [pattern.channels.index(name) for _, _, name in whole[0][0]]
    seen = sites.at_sites(chromaticity * luminance[..., None] * weights, whole)
    error = sites.at_sites(signal, whole) * weights[index] - np.stack([seen[:, :, s, c] for s, c in enumerate(index)], axis=2)
    noise = (variance * weights[index] ** 2).mean(axis=2)
    power = sites.signal_power(error, noise)
    share = (1 - believed) * np.where(noise > 0, power / np.maximum(power + constants._CAUTION * noise, 1e-30), 1.0)

    half, period = (pattern.period - 1) / 2, pattern.period
    origin = np.array(block_corner(pattern, (0, 0))) + half
    first = np.array(next((i, j) for i in range(3) for j in range(3) if block_corner(pattern, (i, j)) == _corner(whole, pattern)))
    around = np.stack([blur(plane, constants._AROUND) for plane in np.moveaxis(blocks, 2, 0)], axis=2)
    base = np.empty_like(chromaticity)
    for y, x in np.ndindex(*shape):
        place = (np.array([y, x]) - origin) / period
        wide = np.array([keys(plane, *place) for plane in np.moveaxis(around, 2, 0)])
        part = keys(share, *(place - first))
        base[y, x] = chromaticity[y, x] + part * (wide - chromaticity[y, x])

    smooth = _laplacian(luminance)
    pinned = np.empty_like(chromaticity)
    for channel in range(len(gamma)):
        weight, right = np.zeros(shape), np.zeros(shape)
        for i, row in enumerate(whole):
            for j, tile in enumerate(row):
                mean = np.mean([luminance[y, x] ** 2 for y, x, _ in tile])
                for site, (y, x, name) in enumerate(tile):
                    if name == pattern.channels[channel] and luminance[y, x] > 1e-6:
                        bright = luminance[y, x] ** 2 / mean
                        shown, own = power[i, j] * bright, constants._CAUTION * variance[i, j, site] * weights[channel] ** 2
                        weight[y, x] = (1 - believed[i, j]) * min(bright, 1) * (shown / max(shown + own, 1e-30) if own > 0 else 1)
                        right[y, x] = weight[y, x] * (signal[y, x] / luminance[y, x] - base[y, x, channel])
        matrix = sparse.diags(weight.ravel() + constants._FADING) + smooth
        pinned[..., channel] = base[..., channel] + spsolve(matrix.tocsc(), right.ravel()).reshape(shape)
    total = (pinned @ weights)[..., None]
    return np.where(total > constants._LEAST_SUM, pinned / total, chromaticity)


def _corner(whole: list[list[list[tuple[int, int, str]]]], pattern: CfaPattern) -> tuple[int, int]:
    """Top left pixel of the first whole tile: not above or left of its own sites, and at the tile's phase."""
    y, x = min(row for row, _, _ in whole[0][0]), min(column for _, column, _ in whole[0][0])
    return y - (y - pattern.origin[0]) % pattern.period, x - (x - pattern.origin[1]) % pattern.period


def _laplacian(luminance: DoubleArray) -> sparse.csr_matrix:
    """The matrix of the sum of squared differences between neighbours, which count little across edges of luminance."""
    (height, width), edge = luminance.shape, constants._EDGE * luminance.mean()
    matrix = sparse.lil_matrix((height * width, height * width))
    for y, x in np.ndindex(height, width):
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            if y + down < height and 0 <= x + right < width:
                step = luminance[y + down, x + right] - luminance[y, x]
                tie = constants._SMOOTHNESS * (0.5 if down and right else 1) / (1 + (step / edge) ** 2)
                one, other = y * width + x, (y + down) * width + x + right
                for place in (one, other):
                    matrix[place, place] += tie
                matrix[one, other] -= tie
                matrix[other, one] -= tie
    return matrix.tocsr()
