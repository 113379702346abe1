"""Luminance beyond full scale, from the colour samples, which saturate later than the panchromatic
ones; not in the paper.

A panchromatic pixel reads all channels together and so reaches full scale about a stop and a half
before a colour pixel does. Each block measures every channel: by Eq. 7 they add up to the luminance
that the clipped samples around it would have read,

    L = sum_i gamma_i u_i,

where u_i is the reading of channel i, or what a white surface would read if that is clipped. Where
all are clipped, the block is white, as bright as the channel that clips last allows. P is L,
interpolated between blocks, each of which counts by the darkest sample around it: what a block
reads under a stroke or an edge is not the light of the clipped samples beside it. A clipped
panchromatic sample m becomes P, and next to unclipped ones a mean with them, as where an edge
passes through a pixel, but never less than m.

A highlight smaller than the distance of two blocks, or the rim of one beside the dark, lies between
blocks: none measures its light or its colour. Such places are lost, and the render reports them.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from ...shared import CfaPattern, Mosaic, NoiseModel
from ...shared.arrays import STRIP, BoolArray, ByteArray, DoubleArray, FloatArray
from ...shared.progress import SILENT, Progress
from ...shared.white_balance import clipped_share, raised_to_white
from ..frame import Frame
from ..numerics.chunks import BLOCK_ROWS, in_strips
from ..numerics.gaussian import filtered, gaussian, smoothed
from ..numerics.interpolation import interpolate
from ..stage import Between, StageSettings


@dataclass(frozen=True)
class HighlightsSettings(StageSettings):
    """Panchromatic samples at the sensor's limit.

    Attributes
    ----------
    restored : bool
        Take luminance there from the colour samples.
    shoulder : Between
        The uppermost fraction of the colour samples' own range, in which they gradually count as
        clipped, 0 to 1.
    """

    restored: bool = False
    shoulder: Between = 0.05


# Chosen on over-exposed photographs, lamps and print.
# Fractions of the limit: the darkest sample around a block that knows nothing of the light of
# clipped ones, and around one that knows it; the least count of a block
_BRIGHT, _LEAST = (0.6, 0.8), 1e-3
_LENDING_WIDTH = 1.0  # blocks: standard deviation of the neighbourhood whose light one takes
_BLUR = 0.5  # pixels: standard deviation of the mean of a clipped sample and those beside it
# Fractions of the limit: a block inside a highlight has no darker sample around it than the second,
# one outside has one below the first. On shots of three photographs 0.85 and 0.97 turn up to four
# times as many restored pixels white, and 0.6 and 0.8 leave a third more of the lost ones grey.
_MEASURES = 0.65, 0.85
_FARTHEST = 3  # blocks from which light reaches what clipped samples touch: it is lent as far
# places of a period whose samples are counted at most; codes below one at which samples pile up,
# times their mean number that it has, and its least share; deviations of noise, in steps of codes
_PLACES, _DOZEN, _PILED, _SHARE, _SPREAD = 4, 12, 8, 5e-4, 4


def clipping_level(mosaic: Mosaic, noise: NoiseModel | None = None) -> float:
    """Scene units from which on a sample counts as saturated; infinite for samples that are not
    sensor codes.

    noise: of the mosaic; where it is known, samples that pile up below the white level tell that
    the sensor saturates there.
    """
    if mosaic.samples.dtype != np.uint16:
        return np.inf
    calibration, scale = mosaic.calibration, float(mosaic.calibration.scale().max())
    code = _pile_up(mosaic, noise) if noise else None
    lower = 0 if code is None else calibration.white_level - code
    return calibration.full_scale - (lower + 0.5) * scale


def _pile_up(mosaic: Mosaic, noise: NoiseModel) -> int | None:
    """Return the code at which the brightest panchromatic samples pile up: hardly any has a higher
    one, and each of the dozen below it far fewer, though noise spreads samples wider; None = at
    none. Of a large pattern some of the samples are counted.
    """
    calibration, period = mosaic.calibration, mosaic.pattern.period
    places = np.argwhere(mosaic.pattern.panchromatic_mask((period, period)))
    counts = np.zeros(1 << 16, np.intp)
    for down, across in places[:: -(-len(places) // _PLACES)].tolist():
        samples = mosaic.codes[down::period, across::period]
        counts += np.bincount(samples.ravel(), minlength=len(counts))
    used = np.flatnonzero(counts)
    number, total = counts[used], counts.sum()
    if len(used) <= _DOZEN:
        return None
    sums = np.append(0, number.cumsum())
    code, count, above = used[_DOZEN:], number[_DOZEN:], total - sums[_DOZEN + 1 :]
    below = (sums[_DOZEN:-1] - sums[: -_DOZEN - 1]) / _DOZEN
    step = (code - used[:-_DOZEN]) / _DOZEN  # codes of many bits may have gaps
    scale = float(calibration.scale()[-1])
    signal = ((code - calibration.black_level[-1]) * scale).astype(np.float32)
    spread = np.sqrt(noise.variance(signal)) / scale
    piled = (count > _PILED * below) & (spread > _SPREAD * step)
    piled &= code < calibration.white_level
    piled &= (count > _SHARE * total) & (above < 2 * _SHARE * total) & (2 * signal > signal.max())
    return int(code[piled].max()) if piled.any() else None


def restore_highlights(
    frame: Frame, settings: HighlightsSettings, progress: Progress = SILENT
) -> Frame:
    """Replace saturated samples by estimates above them, and note where light is lost; without such
    samples, the frame itself.

    Parameters
    ----------
    frame : Frame
        Free of defects: a single hot colour sample would pass for light.
    """
    signal, clipping, sites = frame.signal, frame.clipping, frame.sites
    if not settings.restored or not signal.max() >= clipping:
        return frame
    progress.stage("restoring highlights", 1)
    samples, gamma, read = frame.samples, frame.gamma, np.flatnonzero(sites.pattern.site_counts)
    neutral = np.array(frame.mosaic.calibration.neutral or np.ones(len(gamma)), samples.dtype)
    result, total, gone = signal.copy(), np.empty(sites.shape), np.empty(sites.shape)

    def restore(rows: slice) -> None:
        means = sites.means(samples[rows])
        measured = means.take(read, axis=2)
        limits: NDArray[Any] = clipping * frame.colour_gains(rows, read)
        clipped = clipped_share(measured, limits, settings.shoulder)
        measured = raised_to_white(measured, clipped, limits, neutral[read])
        # a channel without sites: as in white of the mean brightness of the others
        raised = neutral * (measured / neutral[read]).mean(axis=2, keepdims=True)
        raised[..., read] = measured
        # in proportion, so that two sites of one channel keep their difference
        raise_by = raised / np.where(means > 0, means, 1)
        for site, (place, channel) in enumerate(zip(sites.at(rows), sites.channels, strict=True)):
            result[place] = samples[rows, :, site] * raise_by[..., channel]
        total[rows], gone[rows] = raised @ gamma, clipped.prod(axis=2)

    in_strips(restore, len(total), BLOCK_ROWS)
    lowest, highest = frame.around.lowest / clipping, frame.around.highest / clipping
    luminance = lent(total, lowest).astype(np.float32)
    # where a pattern is not scattered, clipped samples may lie between the blocks
    touched = highest if sites.pattern.is_scattered else maximum_filter(highest, 3)
    unknown = unmeasured(lowest, touched, gone).astype(np.float32)
    lost, pattern = np.zeros(signal.shape, np.uint8), frame.pattern
    halo = len(gaussian(_BLUR)) // 2

    def spread(inner: slice) -> None:
        top = max(inner.start - halo, 0)
        nearby, kept = signal[top : inner.stop + halo], slice(inner.start - top, inner.stop - top)
        if not nearby.max() >= clipping:
            return
        clear = pattern.panchromatic_mask(nearby.shape, (top, 0))
        first = (sites.middle[0] - top, sites.middle[1])
        plane = np.empty_like(nearby)
        over = clear & (nearby >= clipping)
        interpolate(unknown, first, pattern.period, plane)
        lost[inner] = shown_at_sites(np.where(over, plane, 0), clear, pattern)[kept]
        interpolate(luminance, first, pattern.period, plane)
        filled = np.where(over, np.maximum(plane, nearby), nearby)
        mean, count = smoothed(np.stack([clear * filled, clear]).astype(np.float32), _BLUR)
        raised = mean / np.where(over, count, 1)
        np.copyto(result[inner], np.maximum(raised, nearby)[kept], where=over[kept])

    in_strips(spread, len(signal), STRIP // 2)
    progress.advance()
    return replace(frame.with_samples(result), lost=lost)


def lent(luminance: DoubleArray, lowest: DoubleArray) -> DoubleArray:
    """`luminance` of blocks, (rows, columns), where a block with a darker sample around it takes
    that of those near it which have none.

    Parameters
    ----------
    lowest : DoubleArray
        The darkest panchromatic sample around each block, as a fraction of the limit.
    """
    none, full = _BRIGHT
    known = np.clip((lowest - none) / (full - none), _LEAST, 1)
    weight, total = smoothed(np.stack([known, known * luminance]), _LENDING_WIDTH)
    return known * luminance + (1 - known) * total / weight


def unmeasured(lowest: DoubleArray, touched: DoubleArray, gone: DoubleArray) -> DoubleArray:
    """Degree to which blocks do not measure the clipped light around them, 0 to 1, float64 (rows,
    columns).

    A block measures a highlight if it lies inside it, and its surroundings as far as the next
    blocks; farther where clipped samples touch the blocks in between, or those beside them, as on
    paper with small print and in the sky behind twigs. A dark block beside one whose channels are
    all clipped lies beyond the rim of a burnt-out light: what is clipped between the two is burnt
    out too.

    Parameters
    ----------
    lowest, touched : DoubleArray
        The darkest panchromatic sample around each block, and the brightest around it or the blocks
        beside it, as fractions of the limit.
    gone : DoubleArray
        How far all channels of each block are clipped, 0 to 1.
    """
    none, all_known = _MEASURES
    inside = np.clip((lowest - none) / (all_known - none), 0, 1)
    near, beside = maximum_filter(inside, 3), maximum_filter(inside * gone, 3)
    wide = maximum_filter(inside * (1 - gone), 2 * _FARTHEST + 1)
    near = np.maximum(near, (touched >= 1) * wide)
    return 1 - near + near * (inside * gone + (1 - inside) * beside)


def shown_at_sites(lost: FloatArray, clear: BoolArray, pattern: CfaPattern) -> ByteArray:
    """Lost panchromatic samples, and their mean at the colour sites between them, uint8 (H, W); 255
    = all of it.

    Parameters
    ----------
    lost : FloatArray
        (H, W), 0 where a sample is not clipped; about 0 to 1 elsewhere.
    clear : BoolArray
        Which pixels are panchromatic.
    """
    # pixels from a colour site to a panchromatic one
    reach = 1 if pattern.is_scattered else -(-min(pattern.block_shape) // 2)
    even = np.full(1 + 2 * reach, 1 / (1 + 2 * reach), np.float32)
    total, count = filtered(np.stack([lost.clip(0, 1), clear]), even)
    mean = total / np.maximum(count, 1e-3)  # counts that matter are at least a ninth
    return np.rint(255 * np.where(clear, lost, mean).clip(0, 1)).astype(np.uint8)
