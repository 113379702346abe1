"""Replace defective samples, listed in the calibration or detected as outliers, by what their surroundings predict.

A panchromatic sample is judged by its neighbours. A colour sample has no neighbours of its own filter. But by Eq. 7 the channels of
its block must add up to the luminance around the block; if they do not, the sample that deviates most from the neighbouring
blocks' prediction is the defective one. So texture and small bright objects, which all samples of a block see, stay.

A defective colour sample is replaced by what the rest of its block predicts, so it carries no information of its own into Eqs. 8-9.
"""

from typing import NamedTuple

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..blocks import sum_noise, tile
from ..cleaned import Cleaned
from ..kernels.outliers import find_outliers, mend_panchromatic
from ..kernels.pieces import copied
from ..settings import DefectsSettings

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
