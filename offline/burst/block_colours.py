"""Which blocks of a frame deviate from the colours of the reference around them, whatever their luminance.

Something may move in front of something else of the same luminance. The shares of the channels in its blocks then lie outside those
of all blocks of the reference nearby. A thin coloured line may do the same to a single block, so a deviation counts where four
blocks together show it, or most of a neighbourhood.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import grey_opening, map_coordinates, maximum_filter, minimum_filter

from shared.arrays import DoubleArray, FloatArray
from shared.mosaic import Mosaic
from shared.motion import Motion

from ..blocks import Sites
from ..gaussian import gaussian, smoothed
from .frames import DEVIATIONS, FILL_ERROR, NEIGHBOURHOOD, TINY, Frame

# Chosen on a thing that only its colour shows: half and twice of each change its picture by the decibels in brackets.
_BLOCK, _AROUND = 0.03, 0.02  # share of the light by which a channel may differ: of one block, and over a neighbourhood (0.02, 0.2)
_WIDTH = 1.5  # blocks: standard deviation of that neighbourhood (0.4)
_RANGE = 1.5  # standard deviations by which noise makes nine figures exceed their middle: 1.49 is expected of the largest (0.3)
_SHARED = 0.15  # variance of the middle of that range, relative to one figure's; neighbours share it (0.1)
_FRINGE = 3  # blocks: a deviation counts for its neighbours too, as the thing ends somewhere between (1.1)


class BlockColours(NamedTuple):
    """The readings of the whole blocks of a frame, float64, units of the reference.

    channels: times gamma, (C, rows, columns).
    light: luminance, (rows, columns).
    contrast: variance of luminance around them, without noise, (rows, columns).
    noise: variance of the noise of `channels`, that of luminance included, (C, rows, columns).
    """

    channels: DoubleArray
    light: DoubleArray
    contrast: DoubleArray
    noise: DoubleArray


def colour_change(known: BlockColours, frame: Frame, motion: Motion, mosaic: Mosaic) -> FloatArray:
    """Squared deviation of each whole block of the frame, (block rows, block columns), in units of the tolerance.

    known: the colours of the reference. mosaic: the reference.
    """
    sites = Sites.in_frame(mosaic)
    first, period = np.array(sites.middle)[:, None, None], sites.grid.period
    rows, columns = first + period * np.indices(sites.shape)
    places = motion.back(rows, columns, mosaic.shape)
    at = (np.stack(places) - first) / period

    def there(planes: DoubleArray) -> DoubleArray:
        return np.stack([map_coordinates(plane, at, order=1, mode="nearest") for plane in planes])

    channels, light, rough, noise = known
    shares = channels / np.maximum(light, TINY)
    low, high = (np.stack([extreme(plane, 3) for plane in shares]) for extreme in (minimum_filter, maximum_filter))
    middle_share, half = there((low + high) / 2), there((high - low) / 2)
    half = np.maximum(half - _RANGE * there(np.sqrt(noise) / np.maximum(light, TINY)), 0)
    seen, light, other, own = block_colours(frame, mosaic)
    beyond = seen - np.clip(seen, (middle_share - half) * light, (middle_share + half) * light)
    filled = np.square(FILL_ERROR * middle_share) * (other + there(rough[None]))
    expected = there(noise)
    spread = DEVIATIONS**2 * (own + expected)
    alone = np.square(beyond) / (np.square(_BLOCK * light) + filled + spread + TINY)
    cap = np.sqrt(2 * np.square(_AROUND * light) + spread + TINY)
    mean = smoothed(np.clip(beyond, -cap, cap), _WIDTH)
    left = float(np.square(gaussian(_WIDTH)).sum()) ** 2
    spread = DEVIATIONS**2 * (left * own + _SHARED * expected)
    around = np.square(mean) / (np.square(_AROUND * light) + smoothed(filled, _WIDTH) + spread + TINY)
    found = np.maximum(grey_opening(alone.sum(axis=0), (2, 2)), around.sum(axis=0))
    return maximum_filter(found, _FRINGE).astype(np.float32)


def on_pixels(deviation: FloatArray, motion: Motion, mosaic: Mosaic, rows: slice) -> FloatArray:
    """The largest deviation of the four blocks around each pixel in some rows of the reference, (rows, W)."""
    sites = Sites.in_frame(mosaic)
    worst = np.pad(deviation, 1, mode="edge")
    worst = np.maximum(np.maximum(worst[:-1, :-1], worst[1:, :-1]), np.maximum(worst[:-1, 1:], worst[1:, 1:]))
    cells = [
        np.floor((place - np.float32(first)) / sites.grid.period).astype(np.intp).clip(-1, size - 2) + 1
        for place, first, size in zip(motion.places(rows, mosaic.shape), sites.middle, worst.shape, strict=True)
    ]
    return worst[cells[0], cells[1]]


def block_colours(frame: Frame, mosaic: Mosaic) -> BlockColours:
    """The colours of the blocks of a frame, which is in units of the reference. mosaic: the reference."""
    gamma = np.array(mosaic.calibration.gamma)
    sites = Sites.in_frame(mosaic)
    light = sites.of(frame.luminance).mean(axis=2, dtype=np.float64)
    near = smoothed(frame.luminance, NEIGHBOURHOOD)
    rough = smoothed(np.square(frame.luminance - near), NEIGHBOURHOOD) - frame.variance(near)
    contrast = np.maximum(sites.of(rough).mean(axis=2, dtype=np.float64), 0)
    light = np.maximum(light, DEVIATIONS * frame.noise.sigma(0.0) if frame.noise else TINY)  # in less light shares are noise
    values = sites.means(frame.colours.astype(np.float64))
    seen, noise = gamma * values, np.zeros_like(values)
    if frame.noise:
        own = frame.noise.variance(values, np.arange(len(gamma))) * gamma**2 / np.bincount(sites.channels)
        filled = np.square(seen / np.maximum(light, TINY)[..., None]) / len(sites.channels)
        noise = own + filled * frame.variance(light)[..., None]
    return BlockColours(np.moveaxis(seen, 2, 0), light, contrast, np.moveaxis(noise, 2, 0))
