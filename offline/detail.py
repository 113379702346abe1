"""Detail of colour that the oriented medians took, given back where the blocks vouch for it.

Medians take what a block's neighbours do not share: errors, and fine detail of colour. Errors of a block's chromaticity, from noise
and from luminance that was filled wrongly, also keep its channels from adding up to its luminance (Eq. 7); detail does not. So
around each block what the medians took is compared with what is missing from the sum: the more it exceeds that, the more of it was
detail. Both are weighed by light, as they will be seen, and where noise alone explains what was taken, nothing is given back.
"""

import numpy as np

from shared.arrays import BORDER, DoubleArray

from .refinement import gaussian

_WIDTH = 2.0  # blocks: standard deviation of the neighbourhood that is compared
_TINY = 1e-30


def give_back(
    own: DoubleArray,
    smooth: DoubleArray,
    weight: DoubleArray,
    product: DoubleArray,
    sigma: float,
    gamma: DoubleArray,
    trust: float,
) -> DoubleArray:
    """Chromaticities between `smooth`, those after the medians, and `own`, those before; all (rows, columns, C).

    weight, product, sigma: of `block_sums`; gamma: (C,). trust: more than 0; the squared error of the sum over this is what errors
    are taken to have added to the squared difference.
    """
    light = weight.mean(axis=2)
    missing = ((product + sigma**2 / gamma.sum()) / (weight + sigma**2)) @ gamma - 1
    error = _around(light * missing**2)
    noise = _around((sigma**2 * light[..., None] / (weight + sigma**2)).sum(axis=2))
    taken = _around(light * ((own - smooth) ** 2).sum(axis=2))
    share = np.clip(1 - (error / trust + noise) / np.maximum(taken, _TINY), 0, 1)
    return smooth + share[..., None] * (own - smooth)


def _around(plane: DoubleArray) -> DoubleArray:
    """(rows, columns) under a Gaussian, mirrored at the border."""
    taps = gaussian(_WIDTH)
    for _ in range(2):
        wide = np.pad(plane, ((len(taps) // 2,) * 2, (0, 0)), mode=BORDER)
        total = np.zeros_like(plane)
        for start, tap in enumerate(taps):
            total += tap * wide[start : start + len(plane)]
        plane = total.T
    return plane
