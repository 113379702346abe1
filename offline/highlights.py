"""Luminance past the limit of the panchromatic samples, from the colour samples, which saturate later.

A panchromatic pixel reads all channels together and so reaches full scale about a stop and a half before a colour pixel does. Each
block measures every channel: by Eq. 7 they add up to the luminance that the clipped samples around it would have read. What channel
clips as well is what a white surface would read there, and where all do, it is white at the limit of the last of them.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.mosaic import Mosaic

from .kernels.highlights import interpolate, raise_clipped
from .progress import SILENT, Progress
from .settings import HighlightSettings

_WIDTH = 1 / 3  # periods: standard deviation of what an unclipped sample has to say of its surroundings
_REACH = 3  # standard deviations
_FAINT = 0.05  # of an unclipped neighbour's weight: so much says that the blocks are right


def clipping_level(mosaic: Mosaic) -> float:
    """Scene units from which on a sample says no more than "at least so much"; infinite for samples that are not sensor codes."""
    if mosaic.samples.dtype != np.uint16:
        return np.inf
    return mosaic.calibration.full_scale - 0.5 * float(mosaic.calibration.scale().max())


def restore_highlights(sound: Mosaic, clipping: float, settings: HighlightSettings, progress: Progress = SILENT) -> Mosaic:
    """The mosaic with samples from `clipping` on (scene units) replaced by estimates that exceed it; itself without any.

    sound: without defects; one hot colour sample would pass for light.
    """
    if not settings.restored or not sound.signal.max() >= clipping:
        return sound
    progress.stage("highlights", 1)
    pattern, grid, signal = sound.pattern, sound.pattern.grid(sound.shape), sound.signal
    rows, columns = grid.rows[grid.inside.any(axis=1)], grid.columns[grid.inside.any(axis=0)]
    gamma = np.array(sound.calibration.gamma)
    count = np.bincount([channel for _, _, channel in pattern.sites])
    places = [(np.ix_(rows + row, columns + column), channel) for row, column, channel in pattern.sites]
    means = np.zeros((len(rows), len(columns), len(gamma)))
    for place, channel in places:
        means[..., channel] += signal[place] / count[channel]
    whole = unclipped(means, clipping, sound.calibration.neutral or (1.0,) * len(gamma), settings.shoulder)
    result = signal.copy()
    for place, channel in places:
        result[place] *= whole[..., channel] / np.where(means[..., channel] > 0, means[..., channel], 1)
    light = np.ascontiguousarray(whole @ gamma, np.float32)
    plane = np.empty_like(signal)
    middle = [float(places[0]) + (size - 1) / 2 for places, size in zip((rows, columns), pattern.block_shape, strict=True)]
    interpolate(light, (middle[0], middle[1]), pattern.period, plane)
    panchromatic = np.ascontiguousarray(pattern.panchromatic_mask((pattern.period,) * 2))
    width = _WIDTH * pattern.period
    fall = np.exp(-(np.arange(int(_REACH * width) + 1) ** 2) / (2 * width**2))
    raise_clipped(signal, panchromatic, clipping, plane, fall, _FAINT, result)
    progress.advance()
    return Mosaic(result, pattern, sound.calibration, sound.metadata)


def unclipped(readings: DoubleArray, clipping: float, neutral: tuple[float, ...], shoulder: float) -> DoubleArray:
    """Readings of the channels (..., C) with clipped ones raised to what white would read beside the others, same units.

    clipping: their limit; neutral: what white reads in each channel, up to scale; shoulder: the part of the range below the limit
    over which a reading goes from measured to clipped. Nothing is lowered.
    """
    white = np.array(neutral)
    gone = np.clip((readings - (1 - shoulder) * clipping) / (shoulder * clipping), 0, 1)
    all_gone = gone.prod(axis=-1, keepdims=True)
    level = ((1 - gone) * readings / white).sum(axis=-1, keepdims=True) + all_gone * clipping / white.min()
    level /= (1 - gone).sum(axis=-1, keepdims=True) + all_gone
    raised: DoubleArray = readings + gone * np.maximum(white * level - readings, 0)
    return raised
