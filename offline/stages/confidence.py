"""Confidence in the colour of each block: full where its samples add up to the luminance around it
(Eq. 7); not in the paper.

If an edge or a stroke runs under a block, its samples show different surfaces, and their ratio is
no chromaticity. Then they do not add up to luminance l as interpolated from the panchromatic
samples around the block, unless by chance. With s the standard deviation of the noise in the sum of
the block's channels c_i,

    confidence = 1 / (1 + (|l - sum_i gamma_i c_i| / (tolerance l + 1.9 s))^4),

and a block takes as much of the chromaticity of its neighbours as it lacks in confidence. A small
thing of a colour of its own does not add up either, so that the tolerance is wide. Beside clipped
samples, which hide strokes, it is narrow, for blocks that are darker than restored luminance.
"""

from dataclasses import dataclass

import numpy as np

from ...shared.arrays import DoubleArray, FloatArray
from ..frame import Frame, mean_of_sites, sum_noise
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

    tolerance: Positive = 0.35


# Chosen; in brackets, by how many decibels half or twice changes the case that it changes most.
_CLIPPED = 0.1  # tolerance of darker blocks beside a clipped sample (0.2)
_AROUND = 1.0  # blocks: standard deviation of the neighbourhood that lends its chromaticity (0.2)
_STEEPNESS = 4  # power of the disagreement in units of the tolerance (0.1)
# standard deviations of its noise that count as agreement: with 3, the worst tenth of photographs
# loses up to 0.1 dB
_NOISE = 1.9
_LEAST_DIVISOR, _LEAST_WEIGHT = 1e-9, 1e-6  # they keep quotients finite
_DIM = 1e-3  # of the mean luminance: darker neighbours count no less


def block_confidence(frame: Frame, settings: ConfidenceSettings) -> DoubleArray:
    """Return confidence in the colour of each whole block, 0 to 1, float64 (rows, columns).

    Parameters
    ----------
    frame : Frame
        Its highlights restored.
    """
    sites, gamma = frame.sites, frame.gamma
    around = sites.surroundings(frame.signal)  # not `frame.around`, which would stay in memory
    filled, clipped = mean_of_sites(around.filled), around.highest >= frame.clipping
    darker = filled - sites.means(sites.of(frame.signal)) @ gamma
    unsure = sum_noise(sites, around.filled, gamma, frame.noise) if frame.noise else 0.0
    tolerance = np.where(clipped, _CLIPPED, settings.tolerance)
    usual = tolerance * np.maximum(filled, _LEAST_DIVISOR) + _NOISE * unsure
    apart = np.where(clipped, np.maximum(darker, 0), np.abs(darker))
    confidence: DoubleArray = 1 / (1 + (apart / usual) ** _STEEPNESS)
    return confidence


def replace_doubtful_colour(
    blocks: FloatArray, frame: Frame, settings: ConfidenceSettings
) -> FloatArray:
    """Chromaticities of all blocks, float32 (block rows, block columns, C); those without
    confidence are replaced by their neighbours', which count by their luminance.

    Parameters
    ----------
    blocks : FloatArray
        As the result, which is `blocks` itself where all are trusted, as where a channel has no
        sites, which Eq. 7 defines.
    """
    if not settings.used or frame.pattern.derived is not None:
        return blocks
    confidence, sites = block_confidence(frame, settings), frame.sites
    whole = sites.whole(blocks).astype(np.float64)
    samples = sites.of(frame.signal, np.float64)  # not `frame.samples`, which would stay in memory
    bright = np.maximum(sites.means(samples) @ frame.gamma / frame.level, _DIM)
    weights = (confidence + _LEAST_WEIGHT) * bright
    weight, *sums = smoothed(
        np.stack([weights, *(weights * plane for plane in np.moveaxis(whole, 2, 0))]), _AROUND
    )
    around = np.stack(sums, axis=2) / weight[..., None]
    around /= (around @ frame.gamma)[..., None]
    return sites.grid.extend((around + confidence[..., None] * (whole - around)).astype(np.float32))
