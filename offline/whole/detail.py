"""Return the detail of colour that the oriented medians removed, where the blocks show that it was detail.

Medians remove what a block's neighbours do not share: errors, and fine detail of colour. Errors of a block's chromaticity, from
noise and from wrongly filled luminance, also violate Eq. 7: the block's channels do not add up to its luminance. Detail does not
violate it. So around each block, what the medians removed is compared with the violation: the more it exceeds the violation, the
more of it was detail. Both are weighted by light, as they will be seen. Where noise alone explains what was removed, nothing is
returned.
"""

import numpy as np

from shared.arrays import DoubleArray

from ..blocks import BlockSums
from ..gaussian import smoothed
from ..kernels.pieces import BLOCK_ROWS, in_strips

_WIDTH = 2.0  # blocks: standard deviation of the neighbourhood that is compared; chosen, half or twice changes 0.07 dB
_TINY = 1e-30  # keeps quotients finite


def give_back(
    unfiltered: DoubleArray, smooth: DoubleArray, sums: BlockSums, sigma: float, gamma: DoubleArray, gain: float
) -> DoubleArray:
    """Chromaticities between those after the medians and those before, (rows, columns, C).

    unfiltered, smooth: chromaticities before and after the medians, (rows, columns, C).
    sums: of the blocks. sigma: sigma_z of Eqs. 8-9.
    gamma: (C,), the weights of Eq. 7.
    gain: > 0. The estimated error energy is (squared violation of Eq. 7) / gain; larger values return more detail.
    """
    weight, product = sums.weight, sums.product
    energies, given = np.empty((3, *weight.shape[:2]), np.float32), np.empty_like(smooth)

    def measure(rows: slice) -> None:
        light = weight[rows].mean(axis=2)
        missing = ((product[rows] + sigma**2 / gamma.sum()) / (weight[rows] + sigma**2)) @ gamma - 1
        energies[0, rows] = light * missing**2
        energies[1, rows] = (sigma**2 * light[..., None] / (weight[rows] + sigma**2)).sum(axis=2)
        energies[2, rows] = light * ((unfiltered[rows] - smooth[rows]) ** 2).sum(axis=2)

    in_strips(measure, len(given), BLOCK_ROWS)
    error, noise, removed = smoothed(energies, _WIDTH)

    def give(rows: slice) -> None:
        share = np.clip(1 - (error[rows] / gain + noise[rows]) / np.maximum(removed[rows], _TINY), 0, 1)
        given[rows] = smooth[rows] + share[..., None] * (unfiltered[rows] - smooth[rows])

    in_strips(give, len(given), BLOCK_ROWS)
    return given
