"""Defective samples, listed in the calibration or outliers, and what their surroundings predict in
their place; not in the paper.

A panchromatic sample m is an outlier if it lies outside the range of its neighbours N (3 x 3
pixels) by more than their contrast (W, 5 x 5 pixels, without the highest and the lowest: there may
be a second defect) and noise explain:

    max(m - max N, min N - m) > contrast (max W - min W) + deviations sigma(max N) + floor

A colour sample c of channel i is a lower bound of luminance, gamma_i c: where it exceeds every
panchromatic neighbour it is one of N, and the end of a thin stroke next to a block is no defect.
Where a colour site beside m is brighter or darker than one period away, the range of N ends as
much higher or lower: both see the same small thing. An outlier becomes the mean of opposite
neighbours; directions d along which luminance changes little (mean |difference|) have the largest
weights 1 / (change |d|)^2.

A colour sample has no neighbours of its own filter. But the channels of a block add up to the
luminance l around it (Eq. 7):

    surplus = sum_i gamma_i c_i - l

If it is more than contrast and noise explain, the sample that deviates most from the neighbouring
blocks' prediction, their median of c / l, is defective. So texture and small bright objects, which
all samples of a block see, stay. So do stars and glints, of which a lens spreads some to the other
sites of the block, or to the panchromatic samples beside. A defective colour sample is replaced by
what the rest of its block predicts, so that it carries no information of its own into Eqs. 8-9.
Where a channel has no sites, no sum is known: there a sample is defective that reads more than
luminance, gamma_i c > l, and lies above the range of the neighbouring blocks.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...shared import NoiseModel
from ...shared.arrays import STRIP, BoolArray, DoubleArray, FloatArray, IndexArray
from ...shared.progress import SILENT, Progress
from ..frame import Frame
from ..numerics.chunks import in_strips
from ..numerics.functions import ORIENTATIONS
from ..stage import NotNegative, Positive, StageSettings


@dataclass(frozen=True)
class DefectsSettings(StageSettings):
    """Samples that do not measure light.

    Attributes
    ----------
    listed : bool
        Replace the samples in the calibration's list of defects.
    contrast : NotNegative
        Multiple of the local contrast, 0 or more; 0 = look for no unlisted defects.
    deviations, floor : NotNegative, Positive
        Multiples of the noise, where it is known, 0 or more; and of the mean panchromatic sample, >
        0. Colour samples are judged by their blocks, with the same settings.
    """

    listed: bool = False
    contrast: NotNegative = 0.0
    deviations: NotNegative = 6.0
    floor: Positive = 0.04


# Chosen; half and twice change none of the measured scenes.
# share of the mean panchromatic sample: darker blocks hold no information about chromaticity
_LEAST_LUMINANCE = 2e-4
_FEWEST = 3  # neighbouring samples, or blocks, that it takes to judge one: a corner has no more
# fraction of the samples: if more than this stand out, they belong to the picture
_MOST_OUTLIERS = 0.03
# deviations of the read noise, and scene units: a sample that is farther below black is dead
_IMPOSSIBLE, _LEAST_IMPOSSIBLE = 12.0, 2e-3
# what a lens spreads of a star, and no defect: fraction of the surplus that the other sites of the
# block see, and of a sample's excess that the panchromatic samples beside it see
_OTHERS, _BESIDE = 0.25, 0.05
_CHANNEL = 1 / 3  # of the floor: about the share of light that a channel sees
_GROWTH = 8  # pixels: largest distance of a good neighbour, where no opposite pair is good
# share of squared samples, and scene units squared: weights are finite where nothing changes
_FLAT, _TINY = 1e-8, 1e-30
# rows, and places, that are looked at together: so they stay in the processor's cache
_ROWS, _TOGETHER = STRIP // 2, 1 << 14


def mend_defects(frame: Frame, settings: DefectsSettings, progress: Progress = SILENT) -> Frame:
    """Replace defective samples; return the frame itself where there are none.

    Defects are those in the calibration's list (places outside the frame are ignored) and isolated
    outliers that are not listed.
    """
    if not (settings.listed or settings.contrast):
        return frame
    progress.stage("replacing defects", 1)
    bad = np.zeros(frame.shape, np.bool_)
    if settings.listed:
        listed = np.array(frame.mosaic.calibration.defects, np.intp).reshape(-1, 2)
        bad[tuple(listed[(listed < frame.shape).all(axis=1)].T)] = True
    if settings.contrast:
        read = frame.noise.sigma(0) if frame.noise else 0.0
        dead = frame.signal < -max(_IMPOSSIBLE * read, _LEAST_IMPOSSIBLE)
        bad |= dead if np.count_nonzero(dead) <= _MOST_OUTLIERS * bad.size else False
        outliers = find_outliers(frame, settings, bad)
        if np.count_nonzero(outliers) <= _MOST_OUTLIERS * bad.size:
            bad |= outliers
    places = _places(bad & frame.pattern.panchromatic_mask(frame.shape))
    if places[0].size:
        signal = frame.signal.copy()
        signal[places] = predicted(frame, bad, places)
        frame = frame.with_samples(signal)
    bad_sites = frame.sites.of(bad)
    if settings.contrast:
        find = _find_in_blocks if frame.pattern.derived is None else _find_above_luminance
        find(frame, bad_sites, settings)
    if bad_sites.any():
        signal, (rows, columns) = frame.signal.copy(), frame.sites.pixels
        signal[rows[bad_sites], columns[bad_sites]] = _predicted_in_blocks(frame, bad_sites)
        frame = frame.with_samples(signal)
    progress.advance()
    return frame


def find_outliers(frame: Frame, settings: DefectsSettings, bad: BoolArray) -> BoolArray:
    """Mark panchromatic samples that differ from all their neighbours by more than contrast and
    noise explain; bool (H, W).

    Parameters
    ----------
    bad : BoolArray
        bool (H, W), samples known to be bad, which are no neighbours.
    """
    outliers = np.zeros_like(bad)

    def work(rows: slice) -> None:
        outliers[rows] = _Strip(frame, settings, bad, rows).outliers()

    in_strips(work, len(bad), _ROWS)
    return outliers


class _Strip:
    """Some rows of a frame, in a halo from which every window of 5 x 5 pixels, and the next period,
    can be seen. bad: bool (H, W).

    luminance: float32 (halo + rows + halo, halo + W + halo); where coloured, its lower bound. NaN =
    bad, or outside the frame. coloured: bool, as `luminance`.
    """

    def __init__(
        self, frame: Frame, settings: DefectsSettings, bad: BoolArray, rows: slice
    ) -> None:
        (height, width), halo = bad.shape, max(frame.pattern.period, 2) + 1
        first = rows.start - halo
        within = slice(max(rows.start - halo, 0), min(rows.stop + halo, height))
        shape = rows.stop + halo - first, width + 2 * halo
        filters = frame.pattern.filter_map(shape, (first, -halo))
        place = np.s_[within.start - first : within.stop - first, halo : halo + width]
        luminance = np.full(filters.shape, np.nan, np.float32)
        gains = np.append(frame.gamma, 1).astype(np.float32)
        signal, good = frame.signal[within], ~bad[within]
        np.multiply(signal, gains[filters[place]], out=luminance[place], where=good)
        self.frame, self.settings, self.halo = frame, settings, halo
        self.luminance, self.coloured = luminance, filters < len(frame.gamma)

    def outliers(self) -> BoolArray:
        """The outliers among its rows, bool (rows, W)."""
        interior, near = (np.s_[edge:-edge, edge:-edge] for edge in (self.halo, self.halo - 1))
        value, floor = self.luminance[interior], self.settings.floor * self.frame.level
        most = _of_neighbours(self.luminance[near], np.fmax)
        panchromatic = np.where(self.coloured, np.float32(np.inf), self.luminance)
        least = _of_neighbours(panchromatic[near], np.fmin)
        beyond = np.maximum(value - most, least - value)
        outliers: BoolArray = (beyond > floor) & ~self.coloured[interior]
        place = _places(outliers)
        outliers[place] = beyond[place] - self.noise(most[place]) > floor
        place = _places(outliers)
        outliers[place] = self.stand_out(*place)
        return outliers

    def noise(self, luminance: FloatArray) -> FloatArray:
        """Difference of panchromatic samples of some luminance that noise explains."""
        noise = self.frame.noise or NoiseModel.gaussian(0.0, len(self.frame.gamma) + 1)
        return np.float32(self.settings.deviations) * np.sqrt(noise.variance(luminance))

    def stand_out(self, row: IndexArray, column: IndexArray) -> BoolArray:
        """Tell for each of N panchromatic samples of its rows whether the sample is an outlier by
        the definition above.
        """
        row, column = row + self.halo, column + self.halo
        value = self.luminance[row, column]
        floor = np.float32(self.settings.floor * self.frame.level)
        near, wide = self.neighbours(row, column, 1), self.neighbours(row, column, 2)
        low = near[:, 0]
        high = np.fmax.reduce(near, axis=1)
        count = np.count_nonzero(~np.isnan(near), axis=1)
        second = wide[np.arange(len(wide)), np.count_nonzero(~np.isnan(wide), axis=1) - 2]
        allowed = self.settings.contrast * (second - wide[:, 1]) + self.noise(high) + floor
        outlier = (count >= _FEWEST) & (np.maximum(value - high, low - value) > allowed)
        given = row, column, value, low, high
        row, column, value, low, high = (values[outlier] for values in given)
        # The usual brightness of the colour sites beside a sample is their mean one period above,
        # below, left and right.
        period, black = self.frame.pattern.period, floor * np.float32(_CHANNEL)
        steps = (-period, 0), (period, 0), (0, -period), (0, period)
        repeats = [_around(self.luminance, row + y, column + x, 1) for y, x in steps]
        usual = _mean(np.stack(repeats), 0).clip(0) + black
        are_sites = _around(self.coloured, row, column, 1)
        sites = np.where(are_sites, _around(self.luminance, row, column, 1), np.float32(np.nan))
        noise = self.noise(high)[:, None]
        darker, brighter = (((sites + step).clip(0) + black) / usual for step in (noise, -noise))
        low = low * np.fmin(np.fmin.reduce(darker, axis=1), 1)
        high = high * np.fmax(np.fmax.reduce(brighter, axis=1), 1)
        outlier[outlier] = np.maximum(value - high, low - value) > allowed[outlier]
        return outlier

    def neighbours(self, row: IndexArray, column: IndexArray, reach: int) -> FloatArray:
        """The neighbours in the squares around N places, (N, pixels), sorted, NaN at the end:
        samples, and lower bounds that exceed all of these.
        """
        luminance = _around(self.luminance, row, column, reach)
        coloured = _around(self.coloured, row, column, reach)
        luminance[:, luminance.shape[1] // 2] = np.nan
        highest = np.fmax.reduce(np.where(coloured, np.float32(-np.inf), luminance), axis=1)
        within = coloured & ~(luminance > highest[:, None])
        return np.sort(np.where(within, np.float32(np.nan), luminance), axis=1)


def _around(plane: NDArray[Any], row: IndexArray, column: IndexArray, reach: int) -> NDArray[Any]:
    """The squares of a plane around N places, (N, pixels)."""
    side = 2 * reach + 1
    windows = sliding_window_view(plane, (side, side))[row - reach, column - reach]
    return windows.reshape(len(row), side**2)


def _places(marked: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Row and column of what is marked; in a quarter of the time of `np.nonzero`."""
    return np.divmod(np.flatnonzero(marked), marked.shape[1])


def _of_neighbours(wide: FloatArray, larger: np.ufunc) -> FloatArray:
    """The largest, or smallest, of the eight around each pixel of a plane that has one pixel more
    on all sides.
    """
    ends = larger(wide[:-2], wide[2:])
    tall = larger(ends, wide[1:-1])
    return larger(larger(tall[:, :-2], tall[:, 2:]), ends[:, 1:-1])


def _mean(values: FloatArray, axis: int | tuple[int, int]) -> FloatArray:
    """Mean of what is not NaN; NaN where nothing is."""
    count = np.count_nonzero(~np.isnan(values), axis=axis)
    mean = np.nansum(values, axis=axis) / np.maximum(count, 1)
    return np.where(count > 0, mean, np.float32(np.nan))


def predicted(frame: Frame, bad: BoolArray, places: tuple[IndexArray, IndexArray]) -> FloatArray:
    """Predict panchromatic samples, float32 (N,), from the good ones around them.

    A place without an opposite pair of good neighbours gets the mean of the nearest good samples,
    and keeps its sample if there is none within eight pixels.
    """
    values = frame.signal[places]

    def work(some: slice) -> None:
        row, column = (place[some] for place in places)
        window, total, weights = _window(frame, bad, row, column, 2), *np.zeros((2, len(row)))
        for down, across in ORIENTATIONS:
            before, after = window[:, 2 - down, 2 - across], window[:, 2 + down, 2 + across]
            right, left = max(across, 0), max(-across, 0)
            apart = window[:, down:, right : 5 - left] - window[:, : 5 - down, left : 5 - right]
            change = np.nan_to_num(_mean(np.abs(apart), (1, 2)))
            flat = _FLAT * (before**2 + after**2) + _TINY
            weight = np.nan_to_num(1 / ((change**2 + flat) * (down**2 + across**2)))
            total += weight * np.nan_to_num(before + after) / 2
            weights += weight
        mean = np.where(weights > 0, total / np.where(weights > 0, weights, 1), np.nan)
        for reach in range(1, _GROWTH + 1):
            lone = np.flatnonzero(np.isnan(mean))
            mean[lone] = _mean(_window(frame, bad, row[lone], column[lone], reach), (1, 2))
        values[some] = np.where(np.isnan(mean), values[some], mean)

    in_strips(work, len(values), _TOGETHER)
    return values


def _window(
    frame: Frame, bad: BoolArray, row: IndexArray, column: IndexArray, reach: int
) -> FloatArray:
    """The good panchromatic samples in the squares around N places, (N, size, size); NaN
    elsewhere.
    """
    steps, (height, width) = np.arange(-reach, reach + 1), bad.shape
    down, across = row[:, None, None] + steps[:, None], column[:, None, None] + steps
    place = down.clip(0, height - 1), across.clip(0, width - 1)
    good = (place[0] == down) & (place[1] == across) & ~bad[place] & _panchromatic(frame, *place)
    return np.where(good, frame.signal[place], np.float32(np.nan))


def _panchromatic(frame: Frame, row: IndexArray, column: IndexArray) -> BoolArray:
    period = frame.pattern.period
    return frame.pattern.panchromatic_mask((period, period))[row % period, column % period]


def _find_in_blocks(frame: Frame, bad: BoolArray, settings: DefectsSettings) -> None:
    """Mark in `bad`, (*B, S), each site that keeps its block from adding up to the luminance around
    it.
    """
    gamma, (filled, lowest, highest) = frame.gamma, frame.around
    # weight of each site in the sum of Eq. 7
    share = (gamma / frame.pattern.site_counts)[frame.sites.channels]
    surplus = frame.samples @ share - filled @ share / gamma.sum()
    tolerance = settings.contrast / 2 * (highest - lowest) + settings.floor * frame.level
    tolerance += settings.deviations * frame.sum_noise(filled)
    odd = np.abs(surplus) > tolerance
    odd &= (highest < frame.clipping) & ~bad.any(axis=2)
    if odd.sum() > _MOST_OUTLIERS * bad.size:
        return
    rows, columns = np.nonzero(odd)
    near, filled, surplus = _ratios_around(frame, bad, rows, columns), filled[odd], surplus[odd]
    # The defective sample explains the surplus, and lies outside the range of the neighbouring
    # blocks.
    excess = share * (frame.samples[odd] - _median(frame, near) * filled)
    block, site = np.arange(len(surplus)), np.argmax(excess * np.sign(surplus)[:, None], axis=1)
    least = _LEAST_LUMINANCE * frame.level
    ratio = frame.samples[rows, columns, site] / np.maximum(filled[block, site], least)
    near, excess = near[:, block, site], excess[block, site]
    low, high = np.fmin.reduce(near), np.fmax.reduce(near)
    certain = np.maximum(ratio - high, low - ratio) > high - low
    certain &= np.abs(surplus - excess) < np.abs(surplus) * _OTHERS
    certain &= np.count_nonzero(~np.isnan(near), axis=0) >= _FEWEST
    down, across = (axis[rows, columns, site] for axis in frame.sites.pixels)
    sound = np.zeros(frame.shape, np.bool_)  # panchromatic samples are mended
    beside, usual = (_mean(_window(frame, sound, down, across, reach), (1, 2)) for reach in (1, 2))
    certain &= ~(np.sign(excess) * (beside - usual) > _BESIDE * np.abs(excess))
    bad[rows[certain], columns[certain], site[certain]] = True


def _find_above_luminance(frame: Frame, bad: BoolArray, settings: DefectsSettings) -> None:
    """Mark in `bad`, (*B, S), each site that reads more than luminance there: where a channel has
    no sites, Eq. 7 defines it, and tells no more than that it is not negative.
    """
    channels, gamma, around = frame.sites.channels, frame.gamma, frame.around
    weights, filled = gamma[channels], around.filled
    tolerance = (settings.contrast / 2 * (around.highest - around.lowest))[..., None]
    tolerance = tolerance + settings.floor * frame.level
    variance = frame.variance(filled.astype(np.float32), slice(0, len(filled)), channels)
    tolerance = tolerance + settings.deviations * weights * np.sqrt(variance)
    odd = (weights * frame.samples - filled > tolerance) & ~bad
    odd &= (around.highest < frame.clipping)[..., None]
    if odd.sum() > _MOST_OUTLIERS * bad.size:
        return
    rows, columns, site = np.nonzero(odd)
    near = _ratios_around(frame, bad | odd, rows, columns)[:, np.arange(len(site)), site]
    ratio = frame.samples[odd] / np.maximum(filled[odd], _LEAST_LUMINANCE * frame.level)
    low, high = np.fmin.reduce(near), np.fmax.reduce(near)
    certain = (ratio - high > high - low) & (np.count_nonzero(~np.isnan(near), axis=0) >= _FEWEST)
    bad[rows[certain], columns[certain], site[certain]] = True


def _predicted_in_blocks(frame: Frame, bad: BoolArray) -> FloatArray:
    """Values for the bad sites: what the rest of the block predicts, else what the neighbouring
    blocks predict.
    """
    gamma, sites, least = frame.gamma, frame.sites, _LEAST_LUMINANCE * frame.level
    rows, columns, site = np.nonzero(bad)
    number, channel, channels = np.arange(len(site)), sites.channels[site], np.arange(len(gamma))
    near, filled = _ratios_around(frame, bad, rows, columns), frame.around.filled[rows, columns]
    here = filled[number, site]
    # c_i = sum of the good samples of a channel / sum of the luminance there
    good = ~bad[rows, columns, None] & (sites.channels == channels[:, None])  # (bad sites, C, S)
    total = (good * filled[:, None]).sum(axis=2)
    measured = total > least
    ratio = (good * frame.samples[rows, columns, None]).sum(axis=2) / np.where(measured, total, 1)
    # Eq. 7: what the other channels leave of the luminance, and what the neighbouring blocks
    # predict. The first is as uncertain as luminance varies around the block, the second as the
    # neighbouring blocks differ.
    others = channels != channel[:, None]
    left = np.maximum(1 - (others * ratio) @ gamma, 0) / gamma[channel] * here
    around = _median(frame, near)[number, site] * here
    spread = np.nan_to_num(np.fmax.reduce(near) - np.fmin.reduce(near))[number, site] * here
    contrast = (frame.around.highest - frame.around.lowest)[rows, columns] / gamma[channel]
    trust = (spread**2 + least**2) / (spread**2 + contrast**2 + 2 * least**2)
    around = np.where((measured | ~others).all(axis=1), around + trust * (left - around), around)
    values = np.where(measured[number, channel], ratio[number, channel] * here, around)
    return values.astype(np.float32)


def _ratios_around(
    frame: Frame, bad: BoolArray, rows: IndexArray, columns: IndexArray
) -> DoubleArray:
    """Ratios c / l of each site in the eight neighbours of N blocks, (8, N, S); NaN where there is
    none, or it is bad or dark.
    """
    filled = frame.around.filled
    unknown = bad | (filled <= _LEAST_LUMINANCE * frame.level)
    ratio = np.where(unknown, np.nan, frame.samples / np.where(filled > 0, filled, 1))
    wide = np.pad(ratio, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    around = [step for step in np.ndindex(3, 3) if step != (1, 1)]
    return np.stack([wide[rows + down, columns + across] for down, across in around])


def _median(frame: Frame, near: DoubleArray) -> DoubleArray:
    """Median of the ratios of neighbouring blocks, (N, S); grey without any."""
    return np.nanmedian(np.where(np.isnan(near).all(axis=0), 1 / frame.gamma.sum(), near), axis=0)
