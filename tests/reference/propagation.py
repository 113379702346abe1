"""Eqs. 10 and 14: chromaticity of a pixel as a convex combination of the blocks at the four corners
of its patch.
"""

import numpy as np

from panchroma.shared import CfaPattern, DoubleArray
from tests.reference.affinity import padded
from tests.reference.geometry import first_patch


def propagate(
    blocks: DoubleArray, affinity: DoubleArray, luminance: DoubleArray, pattern: CfaPattern
) -> DoubleArray:
    """Chromaticity of every pixel, (H, W, C).

    affinity: the fields that `affinity.fields` returns.
    """
    period, area, (top, left) = pattern.period, padded(luminance, pattern), first_patch(pattern)
    result = np.empty((*luminance.shape, blocks.shape[-1]))
    corners = [(a, b) for a in (0, 1) for b in (0, 1)]
    for row, column in np.ndindex(luminance.shape):
        y, x = row - top, column - left
        i, j = y // period, x // period
        kappa = []
        for a, b in corners:
            alpha = affinity[(i + a) % 2, (j + b) % 2, y, x]
            # l[n_j]
            light = max(area[i * period + a * (period - 1), j * period + b * (period - 1)], 0.0)
            kappa.append(alpha**2 * light)  # Eq. 14
        if sum(kappa) == 0:
            kappa = [1.0] * 4
        result[row, column] = sum(
            weight / sum(kappa) * blocks[i + a, j + b]
            for weight, (a, b) in zip(kappa, corners, strict=True)
        )  # Eq. 10
    return result
