"""Luminance beyond full scale, from the colour samples, which saturate later than the panchromatic ones.

A panchromatic pixel reads all channels together and so reaches full scale about a stop and a half before a colour pixel does. Each
block measures every channel: by Eq. 7 they add up to the luminance that the clipped samples around it would have read. A channel
that is clipped too is taken to read what a white surface would; where all are clipped, the block is white, as
bright as the channel that clips last allows.

A highlight smaller than the distance of two blocks, or the rim of one beside the dark, lies between blocks: none measures its light
or its colour. Such places are lost, and the render reports them.

Luminance where the panchromatic samples are clipped: interpolated between blocks, and corrected to meet unclipped samples.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import STRIP, BoolArray, ByteArray, DoubleArray, FloatArray
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress
from shared.white_balance import clipped_share, raised_to_white

from ..cleaned import Cleaned
from ..numerics.arrays import Bools2, Doubles1, Floats2, Frozen2
from ..numerics.compile import Pieces, parallel_kernel
from ..numerics.gaussian import filtered
from ..numerics.interpolation import interpolate
from ..numerics.pieces import BLOCK_ROWS, copied, in_strips
from ..stage import Between, StageSettings


@dataclass(frozen=True)
class HighlightsSettings(StageSettings):
    """Panchromatic samples at the sensor's limit.

    restored: take luminance there from the colour samples.
    shoulder: the uppermost fraction of the colour samples' own range, in which they gradually count as clipped, 0 to 1.
    """

    kernels = "surroundings", "raise_clipped", "interpolate", "smooth"
    asked_by = ("restored",)
    restored: bool = False
    shoulder: Between = 0.05


# Chosen; in brackets, by how many decibels half or twice changes a photograph over-exposed by a stop (README).
_WIDTH = 1 / 3  # periods: standard deviation of the weights with which unclipped samples correct their surroundings (0.9)
_REACH = 3  # standard deviations: what lies beyond weighs 0.01 (0.0)
_BRIGHT = 0.6  # fraction of the limit: blocks with darker samples around them belong to another surface (0.8)
_TOLERANCE = 0.4  # fraction of the limit: samples that differ more than this from the blocks' prediction do not count (1.9)
_RINGS = 3  # blocks from a bright one to the farthest that is taken for the same surface; interpolation needs two (0.1)
# Fractions of the limit: a block inside a highlight has no darker sample around it than the second, one outside has one below the
# first. On shots of three photographs 0.85 and 0.97 turn up to four times as many restored pixels white, and 0.6 and 0.8 leave a
# third more of the lost ones grey.
_MEASURES = 0.65, 0.85
_TINY = 1e-3  # keeps quotients finite: counts are at least a ninth
_FAINT = 0.05  # weight of the blocks' own prediction, relative to an unclipped neighbour (0.2)


def clipping_level(mosaic: Mosaic) -> float:
    """Scene units from which on a sample counts as saturated; infinite for samples that are not sensor codes."""
    if mosaic.samples.dtype != np.uint16:
        return np.inf
    return mosaic.calibration.full_scale - 0.5 * float(mosaic.calibration.scale().max())


def restore_highlights(frame: Cleaned, settings: HighlightsSettings, progress: Progress = SILENT) -> Cleaned:
    """Replace saturated samples by estimates above them, and note where light is lost; without such samples, the frame itself.

    frame: free of defects: a single hot colour sample would pass for light.
    """
    signal, clipping = frame.signal, frame.clipping
    if not settings.used or not signal.max() >= clipping:
        return frame
    progress.stage("highlights", 1)
    pattern, sites, blocks = frame.mosaic.pattern, frame.sites, frame.around
    white, samples, gamma = frame.mosaic.calibration.neutral or (1.0,) * len(frame.gamma), frame.samples, frame.gamma
    result, total, gone = copied(signal), np.empty(sites.shape), np.empty(sites.shape)

    def restore(rows: slice) -> None:
        means = sites.means(samples[rows])
        whole = unclipped(means, clipping, white, settings.shoulder)
        raise_by = whole / np.where(means > 0, means, 1)  # in proportion, so that two sites of one channel keep their difference
        for site, (place, channel) in enumerate(zip(sites.at(rows), sites.channels, strict=True)):
            result[place] = samples[rows, :, site] * raise_by[..., channel]
        total[rows], gone[rows] = whole @ gamma, clipped_share(means, clipping, settings.shoulder).prod(axis=2)

    in_strips(restore, len(total), BLOCK_ROWS)
    light = replace_dark(total, blocks.lowest >= _BRIGHT * clipping).astype(np.float32)
    unknown = unmeasured(blocks.lowest / clipping, gone).astype(np.float32)
    lost = np.zeros(signal.shape, np.uint8)
    middle, width = sites.middle, _WIDTH * pattern.period
    fall = np.exp(-(np.arange(int(_REACH * width) + 1) ** 2) / (2 * width**2))

    def spread(inner: slice) -> None:
        top = max(inner.start - len(fall), 0)
        seen = signal[top : inner.stop + len(fall)]
        if not seen.max() >= clipping:
            return
        plane, raised, kept = np.empty_like(seen), seen.copy(), slice(inner.start - top, inner.stop - top)
        interpolate(unknown, (middle[0] - top, middle[1]), pattern.period, plane)
        clear = pattern.panchromatic_mask(seen.shape, (top, 0))
        lost[inner] = shown_at_sites(np.where(clear & (seen >= clipping), plane, 0), clear, pattern)[kept]
        interpolate(light, (middle[0] - top, middle[1]), pattern.period, plane)
        panchromatic = np.roll(tile(pattern), -top, axis=0)
        raise_clipped(seen, panchromatic, clipping, _TOLERANCE * clipping, plane, fall, _FAINT, raised)
        np.copyto(result[inner], raised[kept], where=clear[kept])

    in_strips(spread, len(signal), STRIP // 2)
    progress.advance()
    return replace(frame.with_samples(result), lost=lost)


def replace_dark(light: DoubleArray, bright: BoolArray) -> DoubleArray:
    """`light` of blocks, (rows, columns), where every block that is not `bright` takes the mean of the bright ones near it.

    A dark block next to a clipped region lies beyond an edge: interpolating towards it would darken the rim of the region.
    """
    known, values = bright.astype(np.float64), np.where(bright, light, 0)
    for _ in range(_RINGS):
        total, weight = (_three_by_three(plane, np.sum) for plane in (values * known, known))
        grown = (known == 0) & (weight > 0)
        values = np.where(grown, total / np.where(weight > 0, weight, 1), values)
        known = np.where(grown, 1, known)
    return np.where(known > 0, values, light)


def unmeasured(lowest: DoubleArray, gone: DoubleArray) -> DoubleArray:
    """How far blocks do not measure the clipped light around them, 0 to 1, float64 (rows, columns).

    A block measures a highlight if it lies inside it, and its surroundings as far as the next blocks. A dark block beside one
    whose channels are all clipped lies beyond the rim of a burnt-out light: what is clipped between the two is burnt out too.

    lowest: the darkest panchromatic sample around each block, as a fraction of the limit.
    gone: how far all channels of each block are clipped, 0 to 1.
    """
    none, all_known = _MEASURES
    inside = np.clip((lowest - none) / (all_known - none), 0, 1)
    near, beside = (_three_by_three(plane, np.max) for plane in (inside, inside * gone))
    return 1 - near + near * (inside * gone + (1 - inside) * beside)


def shown_at_sites(lost: FloatArray, clear: BoolArray, pattern: CfaPattern) -> ByteArray:
    """What is lost of panchromatic samples, and as their mean at the colour sites between them, uint8 (H, W); 255 = all of it.

    lost: (H, W), 0 where a sample is not clipped; about 0 to 1 elsewhere. clear: which pixels are panchromatic.
    """
    reach = 1 if pattern.is_scattered else -(-min(pattern.block_shape) // 2)  # pixels from a colour site to a panchromatic one
    even = np.full(1 + 2 * reach, 1 / (1 + 2 * reach), np.float32)
    total, count = filtered(np.stack([lost.clip(0, 1), clear]), even)
    return np.rint(255 * np.where(clear, lost, total / np.maximum(count, _TINY)).clip(0, 1)).astype(np.uint8)


def _three_by_three(plane: DoubleArray, reduced: Callable[..., DoubleArray]) -> DoubleArray:
    """The sum or the maximum of what is not negative in each place and the eight around it."""
    wide, found = np.pad(plane, 1), np.empty_like(plane)

    def work(rows: slice) -> None:
        around = wide[rows.start : rows.stop + 2]
        shifted = [around[down : len(around) - 2 + down, right : right + plane.shape[1]] for down in range(3) for right in range(3)]
        found[rows] = reduced(shifted, axis=0)

    in_strips(work, len(found), BLOCK_ROWS)
    return found


def unclipped(readings: DoubleArray, clipping: float, neutral: tuple[float, ...], shoulder: float) -> DoubleArray:
    """Raise clipped readings to what a white surface would read, given the other channels; nothing is lowered.

    readings: (..., C), scene units.
    clipping: the limit of the readings.
    neutral: what white reads in each channel, up to scale.
    shoulder: fraction of the range, just below the limit, over which a reading gradually counts as clipped, between 0 and 1.
    """
    return raised_to_white(readings, clipped_share(readings, clipping, shoulder), clipping, neutral)


@parallel_kernel()
def raise_clipped(
    pieces: Pieces,
    signal: Frozen2,
    panchromatic: Bools2,
    clipping: float,
    tolerance: float,
    plane: Floats2,
    fall: Doubles1,
    faint: float,
    result: Floats2,
) -> None:
    """Estimate what the clipped panchromatic samples would have read; never less than the clipped sample.

    The estimate is the blocks' prediction plus the mean difference of nearby unclipped samples from it, weighted by distance. The
    larger a sample's difference, the smaller its weight; from `tolerance` on it is 0: the sample belongs to another surface.

    signal: (H, W), scene units.
    panchromatic: bool (K, K), the pattern from the frame's corner on.
    clipping: scene units from which on a sample is clipped.
    tolerance: scene units, > 0; see above.
    plane: (H, W), luminance that the blocks predict.
    fall: weight at each distance; a sample has fall[rows away] * fall[columns away].
    faint: weight of a difference of 0, which is always added.
    result: (H, W), equal to `signal`; the clipped panchromatic samples are written.
    """
    height, width = signal.shape
    period, reach = len(panchromatic), len(fall) - 1
    for row in range(pieces[0], pieces[1]):
        for column in range(width):
            if not panchromatic[row % period, column % period] or signal[row, column] < clipping:
                continue
            total, weights = 0.0, faint
            for y in range(max(row - reach, 0), min(row + reach + 1, height)):
                for x in range(max(column - reach, 0), min(column + reach + 1, width)):
                    difference = signal[y, x] - plane[y, x]
                    if panchromatic[y % period, x % period] and signal[y, x] < clipping and abs(difference) < tolerance:
                        weight = fall[abs(y - row)] * fall[abs(x - column)] * (1.0 - abs(difference) / tolerance)
                        total += weight * difference
                        weights += weight
            result[row, column] = max(signal[row, column], np.float32(plane[row, column] + total / weights))
