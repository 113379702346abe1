"""Luminance beyond full scale, from the colour samples, which saturate later than the panchromatic ones.

A panchromatic pixel reads all channels together and so reaches full scale about a stop and a half before a colour pixel does. Each
block measures every channel: by Eq. 7 they add up to the luminance that the clipped samples around it would have read. A channel
that is clipped too is taken to read what a white surface would; where all are clipped, the block is white, as
bright as the channel that clips last allows.
"""

from dataclasses import replace

import numpy as np

from shared.arrays import BoolArray, DoubleArray, strips
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress
from shared.white_balance import clipped_share, raised_to_white

from .blocks import gather
from .kernels.highlights import interpolate, raise_clipped
from .settings import HighlightSettings

_WIDTH = 1 / 3  # periods: standard deviation of the weights with which unclipped samples correct their surroundings
_REACH = 3  # standard deviations
_BRIGHT = 0.6  # fraction of the limit: blocks with darker samples around them belong to another surface
_TOLERANCE = 0.4  # fraction of the limit: samples that differ more than this from the blocks' prediction do not count
_RINGS = 3  # blocks from a bright one to the farthest that is taken for the same surface; interpolation needs two
_FAINT = 0.05  # weight of the blocks' own prediction, relative to an unclipped neighbour


def clipping_level(mosaic: Mosaic) -> float:
    """Scene units from which on a sample counts as saturated; infinite for samples that are not sensor codes."""
    if mosaic.samples.dtype != np.uint16:
        return np.inf
    return mosaic.calibration.full_scale - 0.5 * float(mosaic.calibration.scale().max())


def restore_highlights(mosaic: Mosaic, clipping: float, settings: HighlightSettings, progress: Progress = SILENT) -> Mosaic:
    """Replace samples that reach `clipping` (scene units) by estimates above it; without such samples, return the mosaic itself.

    mosaic: free of defects: a single hot colour sample would pass for light.
    """
    signal = mosaic.signal
    if not settings.restored or not signal.max() >= clipping:
        return mosaic
    progress.stage("highlights", 1)
    pattern, gamma = mosaic.pattern, np.array(mosaic.calibration.gamma)
    blocks = gather(mosaic, signal)
    count = np.bincount(blocks.channels)
    means = np.stack([blocks.samples[..., blocks.channels == channel].mean(axis=2) for channel in range(len(count))], axis=2)
    whole = unclipped(means, clipping, mosaic.calibration.neutral or (1.0,) * len(gamma), settings.shoulder)
    result = signal.copy()
    # In proportion, so that two sites of one channel keep their difference.
    result[blocks.places] = blocks.samples * (whole / np.where(means > 0, means, 1))[..., blocks.channels]
    light = replace_dark(whole @ gamma, blocks.lowest >= _BRIGHT * clipping)
    middle = [float(origins[0]) + (size - 1) / 2 for origins, size in zip(blocks.origins, pattern.block_shape, strict=True)]
    width = _WIDTH * pattern.period
    fall = np.exp(-(np.arange(int(_REACH * width) + 1) ** 2) / (2 * width**2))
    height = len(signal)
    for inner in strips(height):
        if not signal[inner].max() >= clipping:
            continue
        top = max(inner.start - len(fall), 0)
        seen = signal[top : inner.stop + len(fall)]
        plane, raised = np.empty_like(seen), seen.copy()
        interpolate(light.astype(np.float32), (middle[0] - top, middle[1]), pattern.period, plane)
        panchromatic = np.roll(blocks.panchromatic, -top, axis=0)
        raise_clipped(seen, panchromatic, clipping, _TOLERANCE * clipping, plane, fall, _FAINT, raised)
        clear = pattern.panchromatic_mask((inner.stop - inner.start, signal.shape[1]), (inner.start, 0))
        np.copyto(result[inner], raised[inner.start - top : inner.stop - top], where=clear)
    progress.advance()
    result.flags.writeable = False
    return replace(mosaic, samples=result)


def replace_dark(light: DoubleArray, bright: BoolArray) -> DoubleArray:
    """`light` of blocks, (rows, columns), where every block that is not `bright` takes the mean of the bright ones near it.

    A dark block next to a clipped region lies beyond an edge: interpolating towards it would darken the rim of the region.
    """
    known, values = bright.astype(np.float64), np.where(bright, light, 0)
    for _ in range(_RINGS):
        total, weight = (_three_by_three(plane) for plane in (values * known, known))
        grown = (known == 0) & (weight > 0)
        values = np.where(grown, total / np.where(weight > 0, weight, 1), values)
        known = np.where(grown, 1, known)
    return np.where(known > 0, values, light)


def _three_by_three(plane: DoubleArray) -> DoubleArray:
    wide = np.pad(plane, 1)
    rows, columns = plane.shape
    shifted = [wide[down : down + rows, across : across + columns] for down in range(3) for across in range(3)]
    return np.sum(shifted, axis=0)  # type: ignore[no-any-return]


def unclipped(readings: DoubleArray, clipping: float, neutral: tuple[float, ...], shoulder: float) -> DoubleArray:
    """Raise clipped readings to what a white surface would read, given the other channels; nothing is lowered.

    readings: (..., C), scene units.
    clipping: the limit of the readings.
    neutral: what white reads in each channel, up to scale.
    shoulder: fraction of the range, just below the limit, over which a reading gradually counts as clipped, between 0 and 1.
    """
    return raised_to_white(readings, clipped_share(readings, clipping, shoulder), clipping, neutral)
