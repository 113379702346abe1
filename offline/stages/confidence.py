"""Confidence in the colour of each block: full where its samples add up to the luminance around it
(Eq. 7); not in the paper.

If an edge or a stroke runs under a block, its samples show different surfaces, and their ratio is
no chromaticity. Then they do not add up to luminance l as interpolated from the panchromatic
samples around the block, unless by chance. With s the standard deviation of the noise in the sum of
the block's channels c_i,

    confidence = 1 / (1 + (|l - sum_i gamma_i c_i| / (tolerance l + 1.9 s))^4),

and a block takes as much of the chromaticity of its neighbours as it lacks in confidence. Beside
clipped samples, where luminance is not known, the tolerance is smaller, and blocks are compared
with one another, too: one that is darker than those around it, as under a stroke of over-exposed
print, is not trusted. Blocks that do add up keep their colour, however saturated.
"""

from dataclasses import dataclass

import numpy as np

from ...shared.arrays import DoubleArray, FloatArray
from ..frame import Cleaned, mean_of_sites, sum_noise
from ..numerics.gaussian import smoothed
from ..stage import Positive, Switch


@dataclass(frozen=True)
class ConfidenceSettings(Switch):
    """Blocks whose samples do not add up to luminance take the colour of their neighbours (see
    `stages.confidence`); not in the paper.

    Attributes
    ----------
    tolerance : Positive
        How far the samples of a block may differ from luminance, relative to it, before half of its
        chromaticity is that of its neighbours, > 0.
    """

    tolerance: Positive = 0.4


# Chosen; in brackets, by how many decibels half or twice changes the case that it changes most.
_CLIPPED = 0.5  # of the tolerance, next to a clipped sample (0.3)
_AROUND = 1.0  # blocks: standard deviation of the neighbourhood that lends its chromaticity (0.2)
# next to a clipped sample: by which share of their light blocks may be darker than those around
_SUNKEN = 0.05
_STEEPNESS = 4  # power of the disagreement in units of the tolerance (0.1)
# standard deviations of its noise that count as agreement: with 3, the worst tenth of photographs
# loses up to 0.1 dB
_NOISE = 1.9
_LEAST_DIVISOR = 1e-9  # keeps divisions by luminance and by confidence finite


def block_confidence(frame: Cleaned, settings: ConfidenceSettings) -> DoubleArray | None:
    """Return confidence in the colour of each whole block, 0 to 1, float64 (rows, columns); None =
    all are trusted, as where a channel has no sites, which Eq. 7 defines.

    Parameters
    ----------
    frame : Cleaned
        Its highlights not restored.
    """
    if not settings.used or frame.mosaic.pattern.derived is not None:
        return None
    around, total = frame.around, frame.sites.means(frame.samples) @ frame.gamma
    light, clipped = mean_of_sites(around.filled), around.highest >= frame.clipping
    # Clipped surroundings read too little: where all of them are clipped the block may exceed them.
    apart = np.where(
        around.lowest >= frame.clipping, np.maximum(light - total, 0), np.abs(light - total)
    )
    tolerance = settings.tolerance * np.where(clipped, _CLIPPED, 1.0)
    unsure = sum_noise(frame.sites, around.filled, frame.gamma, frame.noise) if frame.noise else 0.0
    usual = tolerance * np.maximum(light, _LEAST_DIVISOR) + _NOISE * unsure
    confidence = 1 / (1 + (apart / usual) ** _STEEPNESS)
    if clipped.any():
        confidence[clipped] *= brightness_agreement(total, unsure)[clipped]
    return confidence


def brightness_agreement(total: DoubleArray, unsure: DoubleArray | float = 0.0) -> DoubleArray:
    """Agreement of the brightness of each block with that of its surroundings, 0 to 1, float64
    (rows, columns); brighter ones are: strokes are dark.

    Parameters
    ----------
    total : DoubleArray
        What the channels of a block add up to, scene units.
    unsure : DoubleArray | float, optional
        Standard deviation of its noise.
    """
    around = smoothed(total[None], _AROUND)[0].astype(np.float64)
    usual = np.maximum(_SUNKEN * around + _NOISE * unsure, _LEAST_DIVISOR)
    return 1 / (1 + (np.maximum(around - total, 0) / usual) ** _STEEPNESS)


def replace_doubtful_colour(blocks: FloatArray, frame: Cleaned) -> FloatArray:
    """Chromaticities of all blocks, float32 (block rows, block columns, C); those without
    confidence are replaced by their neighbours'.

    Parameters
    ----------
    blocks : FloatArray
        As the result, which is `blocks` itself where `frame.confidence` is None.
    """
    confidence, sites = frame.confidence, frame.sites
    if confidence is None:
        return blocks
    whole = sites.whole(blocks).astype(np.float64)
    weight, *sums = smoothed(
        np.stack([confidence, *(confidence * plane for plane in np.moveaxis(whole, 2, 0))]), _AROUND
    )
    around = np.stack(sums, axis=2) / np.maximum(weight, _LEAST_DIVISOR)[..., None]
    around /= (around @ frame.gamma)[..., None]
    return sites.grid.extend((around + confidence[..., None] * (whole - around)).astype(np.float32))
