"""Which blocks vouch for their colour: those whose samples add up to the luminance around them (Eq. 7).

If an edge or a stroke runs under a block, its samples show different surfaces, and their ratio is no chromaticity. Then they do not
add up to luminance as interpolated from the panchromatic samples around the block, unless by chance. The less they do, the more the
block takes the chromaticity of its neighbours. Beside clipped samples, where nobody knows how luminance runs, more is asked. Blocks
that do add up keep their colour, however saturated. The paper has none of this.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic

from ..blocks import gather, sum_noise
from ..gaussian import smoothed
from ..settings import SiteSettings

_CLIPPED = 0.5  # of the tolerance, next to a clipped sample
_AROUND = 1.0  # blocks: standard deviation of the neighbourhood that lends its chromaticity
_STEEPNESS = 4  # power of the disagreement in units of the tolerance
_NOISE = 1.9  # standard deviations of its noise that count as agreement: with 3, the worst tenth of photographs loses up to 0.1 dB
_TINY = 1e-9  # keeps divisions by luminance and by trust finite


def trust_in_blocks(mosaic: Mosaic, clipping: float, noise: NoiseModel | None, settings: SiteSettings) -> DoubleArray | None:
    """How far each whole block vouches for its colour, 0 to 1, float64 (rows, columns); None = all do, or nobody asks.

    mosaic: free of defects, highlights not restored.
    clipping: scene units from which on a sample is at the sensor's limit.
    noise: noise of the mosaic; None = unknown, treated as none.
    """
    if not settings.corrected:
        return None
    found = gather(mosaic, mosaic.signal)
    total = np.zeros(found.lowest.shape)
    for channel, weight in enumerate(mosaic.calibration.gamma):
        total += weight * found.samples[..., found.channels == channel].mean(axis=2)
    light = found.light.mean(axis=2)
    # Clipped surroundings read too little: where all of them are clipped the block may exceed them.
    apart = np.where(found.lowest >= clipping, np.maximum(light - total, 0), np.abs(light - total))
    tolerance = settings.agreement * np.where(found.highest >= clipping, _CLIPPED, 1.0)
    unsure = sum_noise(found, np.array(mosaic.calibration.gamma), noise) if noise else 0.0
    trust: DoubleArray = 1 / (1 + (apart / (tolerance * np.maximum(light, _TINY) + _NOISE * unsure)) ** _STEEPNESS)
    return trust


def with_trusted_colour(blocks: FloatArray, trust: DoubleArray | None, mosaic: Mosaic) -> FloatArray:
    """Chromaticities of all blocks, float32 (block rows, block columns, C); those without trust are replaced by their neighbours'.

    blocks: as the result. trust: what `trust_in_blocks` returns; with None, the result is `blocks` itself.
    """
    if trust is None:
        return blocks
    grid, gamma = mosaic.pattern.grid(mosaic.shape), np.array(mosaic.calibration.gamma)
    whole = blocks[grid.inside].reshape(*trust.shape, -1).astype(np.float64)
    weight, *sums = smoothed(np.stack([trust, *(trust * plane for plane in np.moveaxis(whole, 2, 0))]), _AROUND)
    around = np.stack(sums, axis=2) / np.maximum(weight, _TINY)[..., None]
    around /= (around @ gamma)[..., None]
    return grid.extend((around + trust[..., None] * (whole - around)).astype(np.float32))
