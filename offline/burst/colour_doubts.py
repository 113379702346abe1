"""Which blocks of a frame contradict the colour that the reference has around them, whatever their light is.

Something may move in front of something else of the same luminance. Its blocks then read shares of the channels that no block
of the reference nearby has. A thin coloured line, too, meets a block here and misses those there: so a doubt counts where four
blocks together have it, or most of a neighbourhood.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import grey_opening, map_coordinates, maximum_filter, minimum_filter

from shared.arrays import DoubleArray, FloatArray
from shared.mosaic import Mosaic
from shared.motion import Motion

from ..blocks import Sites
from ..gaussian import gaussian, smoothed
from .frames import Frame, scaled, variance
from .frames import smoothed as smoothed_plane

_BLOCK, _AROUND = 0.03, 0.02  # share of the light by which a channel may differ: of one block, and over a neighbourhood
_WIDTH = 1.5  # blocks: standard deviation of that neighbourhood
_FILLED = 0.3  # error of filled luminance relative to the local contrast
_DEVIATIONS = 3.0
_LIT = 3.0  # standard deviations
_RANGE = 1.5  # standard deviations by which noise alone makes the range of nine figures exceed their middle
_SHARED = 0.15  # variance of the middle of that range, relative to one figure's; neighbours share it
_FRINGE = 3  # blocks: a doubt counts for those beside it: nobody knows where between them the thing ends
_NEAR = 1.5  # pixels: standard deviation of the neighbourhood in which contrast is measured
_TINY = 1e-12


class BlockColours(NamedTuple):
    """What the whole blocks of a frame saw, float64, units of the reference.

    channels: times gamma, (C, rows, columns).
    light: luminance, (rows, columns).
    contrast: variance of luminance around them, without noise, (rows, columns).
    noise: variance of the noise of `channels`, that of luminance included, (C, rows, columns).
    """

    channels: DoubleArray
    light: DoubleArray
    contrast: DoubleArray
    noise: DoubleArray


def colour_doubts(known: BlockColours, frame: Frame, motion: Motion, gain: float, mosaic: Mosaic) -> FloatArray:
    """Squared contradiction of each whole block of the frame, (block rows, block columns); from 1 on it is no accident.

    known: the colours of the reference. mosaic: it.
    """
    grid = mosaic.pattern.grid(mosaic.shape)
    middle = (np.array(grid.block_shape) - 1) / 2
    rows, columns = grid.whole_rows + middle[0], grid.whole_columns + middle[1]
    down, across = np.broadcast_arrays(rows[:, None], columns)
    places = motion.back(down, across, mosaic.shape)
    at = [(place - first) / grid.period for place, first in zip(places, (rows[0], columns[0]), strict=True)]

    def there(planes: DoubleArray) -> DoubleArray:
        return np.stack([map_coordinates(plane, at, order=1, mode="nearest") for plane in planes])

    channels, light, rough, noise = known
    shares = channels / np.maximum(light, _TINY)
    low, high = (np.stack([extreme(plane, 3) for plane in shares]) for extreme in (minimum_filter, maximum_filter))
    middle_share, half = there((low + high) / 2), there((high - low) / 2)
    half = np.maximum(half - _RANGE * there(np.sqrt(noise) / np.maximum(light, _TINY)), 0)
    seen, light, other, own = block_colours(frame, mosaic, gain)
    beyond = seen - np.clip(seen, (middle_share - half) * light, (middle_share + half) * light)
    filled = np.square(_FILLED * middle_share) * (other + there(rough[None]))
    expected = there(noise)
    spread = _DEVIATIONS**2 * (own + expected)
    alone = np.square(beyond) / (np.square(_BLOCK * light) + filled + spread + _TINY)
    cap = np.sqrt(2 * np.square(_AROUND * light) + spread + _TINY)
    mean = smoothed(np.clip(beyond, -cap, cap), _WIDTH)
    left = float(np.square(gaussian(_WIDTH)).sum()) ** 2
    spread = _DEVIATIONS**2 * (left * own + _SHARED * expected)
    around = np.square(mean) / (np.square(_AROUND * light) + smoothed(filled, _WIDTH) + spread + _TINY)
    found = np.maximum(grey_opening(alone.sum(axis=0), (2, 2)), around.sum(axis=0))
    doubts: FloatArray = maximum_filter(found, _FRINGE).astype(np.float32)
    return doubts


def on_pixels(doubts: FloatArray, motion: Motion, mosaic: Mosaic, rows: slice) -> FloatArray:
    """The largest doubt of the four blocks around each pixel in some rows of the reference, (rows, W)."""
    grid = mosaic.pattern.grid(mosaic.shape)
    worst = np.pad(doubts, 1, mode="edge")
    worst = np.maximum(np.maximum(worst[:-1, :-1], worst[1:, :-1]), np.maximum(worst[:-1, 1:], worst[1:, 1:]))
    middle = (np.array(grid.block_shape) - 1) / 2
    firsts = grid.whole_rows[0] + middle[0], grid.whole_columns[0] + middle[1]
    cells = [
        np.floor((place - np.float32(first)) / grid.period).astype(np.intp).clip(-1, size - 2) + 1
        for place, first, size in zip(motion.places(rows, mosaic.shape), firsts, worst.shape, strict=True)
    ]
    found: FloatArray = worst[cells[0], cells[1]]
    return found


def block_colours(frame: Frame, mosaic: Mosaic, gain: float) -> BlockColours:
    """The colours of the blocks of a frame that is `gain` times as bright as the reference. mosaic: the reference."""
    gamma = np.array(mosaic.calibration.gamma)
    pattern = mosaic.pattern
    channels = np.array(pattern.sites)[:, 2]
    sites = Sites.in_frame(mosaic)
    light = sites.of(frame.luminance).mean(axis=2, dtype=np.float64) / gain
    near = smoothed_plane(frame.luminance, _NEAR)
    rough = smoothed_plane(np.square(frame.luminance - near), _NEAR) - variance(near, frame.noise)
    contrast = np.maximum(sites.of(rough).mean(axis=2, dtype=np.float64), 0) / gain**2
    seen, noise = np.zeros((2, len(gamma), *light.shape))
    known = scaled(frame.noise, gain)
    light = np.maximum(light, _LIT * known.sigma(0.0) if known else _TINY)  # shares of less light than that say nothing
    for channel, weight in enumerate(gamma):
        mine = channels == channel
        value = frame.colours[..., mine].mean(axis=2, dtype=np.float64) / gain
        seen[channel] = weight * value
        if known:
            own = (known.shot[channel] * np.maximum(value, 0) + known.read[channel] ** 2) * weight**2 / mine.sum()
            filled = np.square(seen[channel] / np.maximum(light, _TINY)) / len(channels)
            noise[channel] = own + filled * (known.shot[-1] * np.maximum(light, 0) + known.read[-1] ** 2)
    return BlockColours(seen, light, contrast, noise)
