"""What a picture states of its errors, pixel by pixel in float64."""

import numpy as np

from shared import CfaPattern
from shared.arrays import DoubleArray
from tests.reference.geometry import block_corner, patch_counts


def uncertainty(
    luminance: DoubleArray,
    before: DoubleArray,
    chromaticity: DoubleArray,
    blocks: DoubleArray,
    variances: tuple[DoubleArray, DoubleArray],
    pattern: CfaPattern,
    gamma: tuple[float, ...],
    weights: tuple[tuple[float, ...], ...],
) -> DoubleArray:
    """Standard deviations, (H, W, 1 + C). before: luminance before its correction. variances: of noise and of grain, (H, W)."""
    (height, width), count = luminance.shape, len(gamma)
    found = np.zeros((height, width, 1 + count))
    panchromatic = pattern.panchromatic_mask((height, width))
    shares = chromaticity * np.array(gamma)
    for y, x in np.ndindex(height, width):
        near = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
        wide = [row for row in range(y - 3, y + 4, 2) if 0 <= row < height], slice(max(x - 3, 0), x + 4)
        light, noise, grain = (float(plane[y, x]) for plane in (luminance, *variances))
        contrast = float(luminance[near].var())
        parts = [noise, noise**0.5 * parallel(noise**0.5, contrast**0.5), parallel(noise, grain)]
        parts += [0.0, 0.0, 0.0] if panchromatic[y, x] else [contrast, grain, contrast**0.5 * abs(light - float(before[y, x]))]
        found[y, x, 0] = np.dot(weights[0], parts) ** 0.5
        between = at(blocks, pattern, luminance.shape, y, x) * gamma
        for i in range(count):
            spread = float(shares[wide][..., i].var()) * light**2
            apart = (float(shares[y, x, i] - between[i]) * light) ** 2
            parts = [noise, grain, spread, apart, contrast, (noise * spread) ** 0.5]
            found[y, x, 1 + i] = np.dot(weights[1], parts) ** 0.5 / gamma[i]
    return found


def parallel(a: float, b: float) -> float:
    return a * b / (a + b) if a + b else 0.0


def at(blocks: DoubleArray, pattern: CfaPattern, shape: tuple[int, ...], y: int, x: int) -> DoubleArray:
    """The blocks, interpolated linearly between their middles; constant beyond the outermost."""
    corner, found = block_corner(pattern, (0, 0)), blocks
    for here, first, size, count in zip(
        (y, x), corner, pattern.block_shape, patch_counts(pattern, (shape[0], shape[1])), strict=True
    ):
        place = min(max((here - first - (size - 1) / 2) / pattern.period, 0.0), float(count))
        before = int(place)
        found = (1 - place + before) * found[before] + (place - before) * found[min(before + 1, count)]
    return found
