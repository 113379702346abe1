"""Replace defective samples, listed in the calibration or detected as outliers, by what their surroundings predict.

A panchromatic sample is judged by its neighbours. A colour sample has no neighbours of its own filter. But by Eq. 7 the channels of
its block must add up to the luminance around the block; if they do not, the sample that deviates most from the neighbouring
blocks' prediction is the defective one. So texture and small bright objects, which all samples of a block see, stay.

A defective colour sample is replaced by what the rest of its block predicts, so it carries no information of its own into Eqs. 8-9.

Detection of outliers, their replacement from neighbours.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..blocks import sum_noise, tile
from ..cleaned import Cleaned
from ..numerics.arrays import Bools2, Floats1, Floats2, Frozen2, Pair, Scalar, StridedInts1
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import ORIENTATIONS, zeros
from ..numerics.lanes import WIDTH, greater, lesser, load, square_root, store
from ..numerics.pieces import copied
from ..stage import NotNegative, Positive, StageSettings


@dataclass(frozen=True)
class DefectsSettings(StageSettings):
    """Samples that do not measure light.

    An unlisted panchromatic sample is defective if it lies outside its neighbours' range by more than contrast x local contrast +
    deviations x noise sigma + floor x mean panchromatic sample. Colour samples are judged by their blocks, with the same settings.

    listed: replace the samples in the calibration's list of defects.
    contrast: multiple of the local contrast, 0 or more; 0 = look for no unlisted defects.
    deviations, floor: multiples of the noise, where it is known, 0 or more; and of the mean panchromatic sample, > 0.
    """

    kernels = "find_outliers", "mend_panchromatic", "surroundings"
    asked_by = "listed", "contrast"
    listed: bool = False
    contrast: NotNegative = 0.0
    deviations: NotNegative = 6.0
    floor: Positive = 0.04


# Chosen; half and twice change none of the measured scenes (README).
_LEAST_LIGHT = 2e-4  # share of the mean panchromatic sample: darker blocks hold no information about chromaticity
_FEWEST = 3  # neighbouring blocks that it takes to judge a block: a corner has no more
_MOST = 0.01  # fraction of the samples: if more than this stand out, they belong to the picture
_RING = [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1) if down or across]


def mend_defects(frame: Cleaned, settings: DefectsSettings, progress: Progress = SILENT) -> Cleaned:
    """The frame with defective samples replaced; the frame itself where there are none.

    Defects are those in the calibration's list (places outside the frame are ignored) and isolated outliers that are not listed.
    """
    if not settings.used:
        return frame
    progress.stage("defects", 2)
    bad = _listed(frame.mosaic) if settings.listed else np.zeros(frame.mosaic.shape, np.bool_)
    if settings.contrast:
        _find_panchromatic(frame, settings, bad)
    rows, columns = _panchromatic_places(bad, frame.mosaic)
    if len(rows):
        values = np.empty(len(rows), np.float32)
        mend_panchromatic(frame.signal, tile(frame.mosaic.pattern), bad, rows, columns, values)
        signal = copied(frame.signal)
        signal[rows, columns] = values
        frame = frame.with_samples(signal)
    progress.advance()
    bad_sites = frame.sites.of(bad)
    if settings.contrast:
        _find_in_blocks(frame, bad_sites, settings)
    if bad_sites.any():
        signal, (rows, columns) = copied(frame.signal), frame.sites.pixels
        signal[rows[bad_sites], columns[bad_sites]] = _mended(frame, bad_sites)
        frame = frame.with_samples(signal)
    progress.advance()
    return frame


def _listed(mosaic: Mosaic) -> BoolArray:
    bad = np.zeros(mosaic.shape, np.bool_)
    places = np.array(mosaic.calibration.defects, np.intp).reshape(-1, 2)
    places = places[(places < mosaic.shape).all(axis=1)]
    bad[places[:, 0], places[:, 1]] = True
    return bad


def _find_panchromatic(frame: Cleaned, settings: DefectsSettings, bad: BoolArray) -> None:
    mosaic, noise = frame.mosaic, frame.noise
    figures = (noise.shot[-1], noise.read[-1]) if noise else (0.0, 0.0)
    period, gamma = mosaic.pattern.period, mosaic.calibration.gamma
    gains = np.array((*gamma, 0), np.float32)[mosaic.pattern.filter_map((period, period))]
    found, floor = np.zeros(bad.shape, np.bool_), settings.floor * frame.level
    find_outliers(mosaic.signal, gains, settings.contrast, settings.deviations, floor, figures, bad, found)
    found |= bad
    if np.count_nonzero(found) - np.count_nonzero(bad) <= _MOST * bad.size:
        bad[:] = found


def _panchromatic_places(bad: BoolArray, mosaic: Mosaic) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the bad panchromatic samples."""
    rows, columns = np.nonzero(bad)
    panchromatic = tile(mosaic.pattern)
    kept = panchromatic[rows % len(panchromatic), columns % len(panchromatic)]
    return rows[kept], columns[kept]


def _find_in_blocks(frame: Cleaned, bad: BoolArray, settings: DefectsSettings) -> None:
    """Mark in `bad`, (*B, S), each site that keeps its block from adding up to the luminance around it."""
    gamma, channels, (lights, lowest, highest) = frame.gamma, frame.sites.channels, frame.around
    share = (gamma / np.bincount(channels))[channels]  # weight of each site in the sum of Eq. 7
    surplus = frame.samples @ share - lights @ share / gamma.sum()
    tolerance = settings.contrast / 2 * (highest - lowest) + settings.floor * frame.level
    if frame.noise is not None:
        tolerance += settings.deviations * sum_noise(frame.sites, lights, gamma, frame.noise)
    odd = np.abs(surplus) > tolerance
    odd &= (highest < frame.clipping) & ~bad.any(axis=2)
    if odd.sum() > _MOST * bad.size:
        return
    where = np.nonzero(odd)
    around = _around(frame, bad, where)
    light, surplus = lights[where], surplus[where]
    # The defective sample explains the surplus, and lies outside the range of the neighbouring blocks.
    excess = share * (frame.samples[where] - around.middle * light)
    guilty = np.arange(len(surplus)), np.argmax(excess * np.sign(surplus)[:, None], axis=1)
    ratio = (frame.samples[where] / np.maximum(light, _LEAST_LIGHT * frame.level))[guilty]
    low, high = around.lowest[guilty], around.highest[guilty]
    certain = np.maximum(ratio - high, low - ratio) > high - low
    certain &= (np.abs(surplus - excess[guilty]) < np.abs(surplus) / 2) & (around.known[guilty] >= _FEWEST)
    bad[where[0][certain], where[1][certain], guilty[1][certain]] = True


def _mended(frame: Cleaned, bad: BoolArray) -> FloatArray:
    """Values for the bad sites: what the rest of the block predicts, else what the neighbouring blocks predict."""
    gamma, (lights, lowest, highest), least = frame.gamma, frame.around, _LEAST_LIGHT * frame.level
    *where, site = np.nonzero(bad)
    around = _around(frame, bad, tuple(where))
    each, channels = np.arange(len(site)), np.arange(len(gamma))
    light, good = lights[*where], ~bad[*where]
    here, channel = light[each, site], frame.sites.channels[site]
    of_channel = good[:, None] & (frame.sites.channels == channels[:, None])  # (bad sites, C, S)
    seen = of_channel.any(axis=2)
    total = (of_channel * light[:, None]).sum(axis=2)
    seen &= total > least
    ratio = (of_channel * frame.samples[*where][:, None]).sum(axis=2) / np.where(seen, total, 1)
    # Eq. 7: what the other channels leave of the luminance, and what the neighbouring blocks predict. The first is as uncertain as
    # luminance varies around the block, the second as the neighbouring blocks differ.
    others = channels != channel[:, None]
    left = np.maximum(1 - (others * ratio) @ gamma, 0) / gamma[channel] * here
    predicted = around.middle[each, site] * here
    variance = ((highest - lowest)[*where] / gamma[channel]) ** 2 + least**2
    variance_around = ((around.highest - around.lowest)[each, site] * here) ** 2 + least**2
    balanced = (left * variance_around + predicted * variance) / (variance + variance_around)
    unseen = np.where((seen | ~others).all(axis=1), balanced, predicted)
    return np.where(seen[each, channel], ratio[each, channel] * here, unseen).astype(np.float32)


class _Around(NamedTuple):
    """Ratios of sample to luminance of each site in the eight neighbours of some blocks; all (blocks, S).

    middle: median of the ratios.
    lowest, highest: range of the ratios.
    known: how many of the eight neighbours have a good sample at the site.
    """

    middle: DoubleArray
    lowest: DoubleArray
    highest: DoubleArray
    known: IndexArray


def _around(frame: Cleaned, bad: BoolArray, where: tuple[IndexArray, ...]) -> _Around:
    """The neighbourhoods of the blocks at `where`; a site without a good neighbour is grey."""
    grey = 1 / float(frame.gamma.sum())
    rows, columns = (np.add.outer(np.array(steps), places) for steps, places in zip(zip(*_RING, strict=True), where, strict=True))
    there = (rows >= 0) & (rows < bad.shape[0]) & (columns >= 0) & (columns < bad.shape[1])
    place = np.where(there, rows, 0), np.where(there, columns, 0)
    light = frame.around.light[place]
    dark = light <= _LEAST_LIGHT * frame.level
    near = np.where(bad[place] | dark | ~there[..., None], np.nan, frame.samples[place] / np.where(dark, 1, light))
    count = (~np.isnan(near)).sum(axis=0)
    near = np.where(count > 0, near, grey)
    return _Around(np.nanmedian(near, axis=0), np.nanmin(near, axis=0), np.nanmax(near, axis=0), count)


_NEAR, _WIDE = 1, 2  # pixels: radius of the neighbours that a sample must exceed, and of those that show the local contrast; chosen
_FEWEST_NEIGHBOURS = 3  # neighbours that it takes to judge a sample: a corner of the frame has no more
_GROWTH = 8  # pixels: largest distance of a good neighbour, where no opposite pair is good; chosen
_MOST_NEIGHBOURS = (2 * _WIDE + 1) ** 2
_STRIP = 64  # rows of a piece of work; chosen for speed
_SEEN = 1 / 3  # share of the light that a channel sees, about
_ZERO, _INFINITE = np.float32(0), np.float32(np.inf)
_FLAT, _TINY = 1e-8, 1e-30  # share of squared samples, and scene units squared: weights are finite where nothing changes
_SAFE = np.float32(1 - 1e-4)  # of what is allowed: single precision may be wrong by less


@parallel_kernel(pieces=lambda *given: -(-len(given[-1]) // _STRIP))
def find_outliers(
    pieces: Pieces,
    signal: Frozen2,
    gains: Floats2,
    contrast: float,
    deviations: float,
    floor: float,
    noise: tuple[float, float],
    bad: Bools2,
    found: Bools2,
) -> None:
    """Mark panchromatic samples that differ from all their neighbours by more than contrast and noise explain.

    A sample is marked if it lies outside the range of its 3 x 3 neighbours by more than contrast x (range of its 5 x 5 neighbours)
    + deviations x noise sigma + floor. The highest and lowest of the 5 x 5 are left out: there may be a second outlier. A colour
    sample times its gamma is a lower bound of luminance. Where that bound exceeds every panchromatic neighbour it counts as a
    neighbour, so that the end of a thin stroke next to a block is not taken for a defect. And where a colour site beside a sample
    is brighter or darker than usual (`_brightness`), the range of the neighbours ends as much higher or lower: what both see is
    no defect.

    signal: (H, W), scene units.
    gains: (K, K), the pattern from the frame's corner on: gamma at a colour site, 0 at a panchromatic one.
    contrast, deviations, floor: see above and `DefectsSettings`.
    noise: (shot, read) of the panchromatic plane: variance = shot * signal + read**2.
    bad: bool (H, W), samples known to be bad, which are no neighbours.
    found: bool (H, W), marked samples are set.
    """
    height, width = signal.shape
    figures = np.float32(deviations), np.float32(floor), np.float32(noise[0]), np.float32(noise[1] ** 2)
    for strip in range(pieces[0], pieces[1]):
        around = np.empty(_MOST_NEIGHBOURS, np.float32)
        most, least, tall = zeros(3, width + 2 + WIDTH), zeros(3, width + 2 + WIDTH), zeros(2, width + 2 + WIDTH)
        surplus = zeros(width + WIDTH)
        first, last = strip * _STRIP, min((strip + 1) * _STRIP, height)
        _bounds(signal, gains, bad, first - 1, most, least)
        _bounds(signal, gains, bad, first, most, least)
        for row in range(first, last):
            _bounds(signal, gains, bad, row + 1, most, least)
            _stand_out(most, least, row, width, figures, tall, surplus)
            for column in range(width):
                if surplus[column] > 0:
                    found[row, column] = _is_outlier(signal, gains, bad, row, column, contrast, deviations, floor, noise, around)


@kernel
def _bounds(signal: Floats2, gains: Floats2, bad: Bools2, row: int, most: Floats2, least: Floats2) -> None:
    """What the samples of a row say about luminance: it is at most `most`, at least `least`, as neighbours; infinite without."""
    place, period, width = row % 3, len(gains), signal.shape[1]
    for column in range(most.shape[1]):
        most[place, column], least[place, column] = -_INFINITE, _INFINITE
    if row < 0 or row >= len(signal):
        return
    for phase in range(period):
        gain = gains[row % period, phase]
        for column in range(phase, width, period):
            if not bad[row, column]:
                most[place, column + 1] = gain * signal[row, column] if gain > 0 else signal[row, column]
                least[place, column + 1] = _INFINITE if gain > 0 else signal[row, column]


@kernel
def _stand_out(
    most: Floats2,
    least: Floats2,
    row: int,
    width: int,
    figures: tuple[Scalar, Scalar, Scalar, Scalar],
    tall: Floats2,
    surplus: Floats1,
) -> None:
    """Write to `surplus` by how much, at least, samples lie outside the range of their neighbours; infinite without any."""
    deviations, floor, shot, variance = figures
    above, here, below = (row - 1) % 3, row % 3, (row + 1) % 3
    for column in range(0, width + 2, WIDTH):
        ends = greater(load(most, (above, column)), load(most, (below, column)))
        store(tall, (0, column), greater(ends, load(most, (here, column))))
        ends = lesser(load(least, (above, column)), load(least, (below, column)))
        store(tall, (1, column), lesser(ends, load(least, (here, column))))
    for column in range(0, width, WIDTH):
        x = column + 1
        high = greater(load(tall, (0, x - 1)), load(tall, (0, x + 1)))
        high = greater(high, greater(load(most, (above, x)), load(most, (below, x))))
        low = lesser(load(tall, (1, x - 1)), load(tall, (1, x + 1)))
        low = lesser(low, lesser(load(least, (above, x)), load(least, (below, x))))
        beyond = greater(load(most, (here, x)) - high, low - load(least, (here, x)))
        allowed = deviations * square_root(shot * greater(high, _ZERO) + variance) + floor
        store(surplus, column, beyond - _SAFE * allowed)


@kernel
def _is_outlier(
    signal: Floats2,
    gains: Floats2,
    bad: Bools2,
    row: int,
    column: int,
    contrast: float,
    deviations: float,
    floor: float,
    noise: tuple[float, float],
    around: Floats1,
) -> bool:
    """Whether a sample is one that `find_outliers` marks."""
    if gains[row % len(gains), column % len(gains)] > 0 or bad[row, column]:
        return False
    value = signal[row, column]
    count = _neighbours(signal, gains, bad, row, column, _NEAR, around)
    if count < _FEWEST_NEIGHBOURS:
        return False
    low, high, _, _ = _extremes(around, count)
    if low - floor <= value <= high + floor:
        return False
    noisy = deviations * np.sqrt(noise[0] * max(high, 0.0) + noise[1] ** 2)
    least, most = _brightness(signal, gains, bad, (row, column), noisy, _SEEN * floor)
    low, high, allowed = min(low, least * low), max(high, most * high), noisy + floor
    beyond = value - high if value > high else low - value
    if beyond <= allowed:
        return False
    count = _neighbours(signal, gains, bad, row, column, _WIDE, around)
    _, _, low, high = _extremes(around, count)
    return bool(beyond > contrast * (high - low) + allowed)


@kernel
def _brightness(signal: Floats2, gains: Floats2, bad: Bools2, place: Pair, noisy: float, floor: float) -> tuple[float, float]:
    """How bright the good colour sites beside a sample are against what they usually are: the least share of it, and the most.

    The first is 1 or less, the second 1 or more. Usual is the mean of the same site in the tiles above, below, left and right.
    noisy, floor: luminance, of which the first may be noise, and the second makes what is black no brighter than nothing.
    """
    (row, column), period, least, most = place, len(gains), 1.0, 1.0
    for y in range(max(row - _NEAR, 0), min(row + _NEAR + 1, signal.shape[0])):
        for x in range(max(column - _NEAR, 0), min(column + _NEAR + 1, signal.shape[1])):
            gain = gains[y % period, x % period]
            if gain > 0 and not bad[y, x]:
                total, count = 0.0, 0
                for down, across in ((-period, 0), (period, 0), (0, -period), (0, period)):
                    i, j = y + down, x + across
                    if 0 <= i < signal.shape[0] and 0 <= j < signal.shape[1] and not bad[i, j]:
                        total += signal[i, j]
                        count += 1
                if count:
                    seen, usual = gain * signal[y, x], max(gain * total / count, 0.0) + floor
                    least = min(least, (max(seen + noisy, 0.0) + floor) / usual)
                    most = max(most, (max(seen - noisy, 0.0) + floor) / usual)
    return least, most


@kernel
def _extremes(values: Floats1, count: int) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """The lowest and the highest of the first `count` values, and the second lowest and second highest."""
    low, high, next_low, next_high = _INFINITE, -_INFINITE, _INFINITE, -_INFINITE
    for place in range(count):
        value = values[place]
        next_low, next_high = min(next_low, max(low, value)), max(next_high, min(high, value))
        low, high = min(low, value), max(high, value)
    return low, high, next_low, next_high


@kernel
def _neighbours(signal: Floats2, gains: Floats2, bad: Bools2, row: int, column: int, reach: int, around: Floats1) -> int:
    """Collect luminance from the good samples at most `reach` pixels from one, without itself. Returns how many there are."""
    period, count = len(gains), 0
    top, bottom = max(row - reach, 0), min(row + reach + 1, signal.shape[0])
    left, right = max(column - reach, 0), min(column + reach + 1, signal.shape[1])
    highest = np.float32(-np.inf)
    for y in range(top, bottom):
        for x in range(left, right):
            if (y != row or x != column) and gains[y % period, x % period] == 0 and not bad[y, x]:
                around[count] = signal[y, x]
                highest = max(highest, signal[y, x])
                count += 1
    for y in range(top, bottom):
        for x in range(left, right):
            least = gains[y % period, x % period] * signal[y, x]
            if least > highest and gains[y % period, x % period] > 0 and not bad[y, x]:
                around[count] = least
                count += 1
    return count


@parallel_kernel()
def mend_panchromatic(
    pieces: Pieces, signal: Frozen2, panchromatic: Bools2, bad: Bools2, rows: StridedInts1, columns: StridedInts1, values: Floats1
) -> None:
    """Predict the samples at the places (rows, columns) from the good panchromatic samples around them, to `values`.

    The prediction is a mean of opposite neighbours; directions along which luminance changes little have the largest weights.
    Without an opposite pair it is the mean of the nearest good samples. A place with none within eight pixels keeps its sample.
    """
    for place in range(pieces[0], pieces[1]):
        row, column = rows[place], columns[place]
        total, weights = 0.0, 0.0
        for down, across in ORIENTATIONS:
            if _good(panchromatic, bad, row - down, column - across) and _good(panchromatic, bad, row + down, column + across):
                before, after = signal[row - down, column - across], signal[row + down, column + across]
                change = _change_along(signal, panchromatic, bad, row, column, down, across)
                flat = _FLAT * (before * before + after * after) + _TINY
                weight = 1.0 / ((change * change + flat) * (down * down + across * across))
                total += weight * 0.5 * (before + after)
                weights += weight
        if weights > 0.0:
            values[place] = total / weights
        else:
            values[place] = _nearest(signal, panchromatic, bad, row, column)


@kernel
def _change_along(signal: Floats2, panchromatic: Bools2, bad: Bools2, row: int, column: int, down: int, across: int) -> float:
    """Mean absolute difference of good neighbours along a direction, within the 5 x 5 pixels around a place."""
    total, count = 0.0, 0
    for y in range(row - _WIDE, row + _WIDE + 1):
        for x in range(column - _WIDE, column + _WIDE + 1):
            inside = abs(y + down - row) <= _WIDE and abs(x + across - column) <= _WIDE
            if inside and _good(panchromatic, bad, y, x) and _good(panchromatic, bad, y + down, x + across):
                total += abs(signal[y, x] - signal[y + down, x + across])
                count += 1
    return total / count if count else 0.0


@kernel
def _nearest(signal: Floats2, panchromatic: Bools2, bad: Bools2, row: int, column: int) -> float:
    """Mean of the nearest good samples; the sample itself if there are none within `_GROWTH` pixels."""
    for reach in range(1, _GROWTH + 1):
        total, count = 0.0, 0
        for y in range(row - reach, row + reach + 1):
            for x in range(column - reach, column + reach + 1):
                if _good(panchromatic, bad, y, x):
                    total += signal[y, x]
                    count += 1
        if count:
            return total / count
    return float(signal[row, column])


@kernel
def _good(panchromatic: Bools2, bad: Bools2, row: int, column: int) -> bool:
    """Whether a place is inside the frame, panchromatic and not marked bad."""
    period = len(panchromatic)
    inside = 0 <= row < bad.shape[0] and 0 <= column < bad.shape[1]
    return inside and panchromatic[row % period, column % period] and not bad[row, column]
