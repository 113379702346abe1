"""Samples that do not measure light, known beforehand or found by how they stand out, replaced by what those around them say.

A panchromatic sample is judged by its neighbours. A colour sample has none of its kind, but it has company: what the channels of a
block read has to add up to the luminance around it (Eq. 7), and where it does not, the sample that differs from what the blocks
around predict is to blame. So texture and small bright things, which all samples of a block see, stay.

A replaced colour sample is what its block says without it, and so adds nothing to the sums of Eqs. 8-9 but its own agreement.
"""

from typing import NamedTuple

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from .blocks import BlockSamples, gather, tile
from .kernels.outliers import find_outliers, mend_panchromatic
from .settings import DefectSettings

_LEAST_LIGHT = 1e-4  # scene units: darker blocks say nothing of chromaticity
_FEWEST = 3  # blocks around one, without which it cannot be judged
_MOST = 0.01  # part of the samples: where more stand out, it is the picture that is so
_RING = [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1) if down or across]


def mend_defects(
    mosaic: Mosaic, clipping: float, noise: NoiseModel | None, settings: DefectSettings, progress: Progress = SILENT
) -> Mosaic:
    """The mosaic with defective samples replaced; itself where there is nothing to do.

    clipping: scene units, from which on samples are at their limit; noise: of the mosaic, None = unknown. Defects are those of the
    calibration's list (places outside the frame are nobody's) and, blindly, single outliers.
    """
    if not settings.listed and settings.contrast == 0:
        return mosaic
    progress.stage("defects", 2)
    bad = _listed(mosaic) if settings.listed else np.zeros(mosaic.shape, np.bool_)
    if settings.contrast:
        _find_panchromatic(mosaic, noise, settings, bad)
    signal = mosaic.signal
    rows, columns = _panchromatic_places(bad, mosaic)
    if len(rows):
        values = np.empty(len(rows), np.float32)
        mend_panchromatic(signal, tile(mosaic), bad, rows, columns, values)
        signal = signal.copy()
        signal[rows, columns] = values
    progress.advance()
    blocks = gather(mosaic, signal)
    bad_sites = bad[blocks.places]
    gamma = np.array(mosaic.calibration.gamma)
    if settings.contrast:
        _find_in_blocks(blocks, bad_sites, gamma, clipping, noise, settings)
    if bad_sites.any():
        signal = signal.copy() if signal is mosaic.signal else signal
        rows, columns = blocks.places
        signal[rows[bad_sites], columns[bad_sites]] = _mended(blocks, bad_sites, gamma)
    progress.advance()
    if signal is mosaic.signal:
        return mosaic
    signal.flags.writeable = False
    return Mosaic(signal, mosaic.pattern, mosaic.calibration, mosaic.metadata)


def _listed(mosaic: Mosaic) -> BoolArray:
    bad = np.zeros(mosaic.shape, np.bool_)
    places = np.array(mosaic.calibration.defects, np.intp).reshape(-1, 2)
    places = places[(places < mosaic.shape).all(axis=1)]
    bad[places[:, 0], places[:, 1]] = True
    return bad


def _find_panchromatic(mosaic: Mosaic, noise: NoiseModel | None, settings: DefectSettings, bad: BoolArray) -> None:
    figures = (noise.shot[-1], noise.read[-1]) if noise else (0.0, 0.0)
    period, gamma = mosaic.pattern.period, mosaic.calibration.gamma
    gains = np.array((*gamma, 0), np.float32)[mosaic.pattern.filter_map((period, period))]
    found = bad.copy()
    find_outliers(mosaic.signal, gains, settings.contrast, settings.deviations, settings.floor, figures, found)
    if np.count_nonzero(found) - np.count_nonzero(bad) <= _MOST * bad.size:
        bad[:] = found


def _panchromatic_places(bad: BoolArray, mosaic: Mosaic) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the bad panchromatic samples."""
    rows, columns = np.nonzero(bad)
    panchromatic = tile(mosaic)
    kept = panchromatic[rows % len(panchromatic), columns % len(panchromatic)]
    return rows[kept], columns[kept]


def _find_in_blocks(
    blocks: BlockSamples, bad: BoolArray, gamma: DoubleArray, clipping: float, noise: NoiseModel | None, settings: DefectSettings
) -> None:
    """Add to `bad`, (*B, S), the sites that alone keep their block from adding up to its luminance."""
    share = (gamma / np.bincount(blocks.channels))[blocks.channels]  # of each site in what Eq. 7 adds up
    surplus = blocks.samples @ share - blocks.light @ share / gamma.sum()
    odd = np.abs(surplus) > _tolerance(blocks, share, noise, settings)
    odd &= (blocks.highest < clipping) & ~bad.any(axis=2)
    if odd.sum() > _MOST * bad.size:
        return
    where = np.nonzero(odd)
    around = _around(blocks, bad, where, 1 / float(gamma.sum()))
    light, surplus = blocks.light[where], surplus[where]
    # The sample to blame explains the surplus, and is outside all that the blocks around read.
    excess = share * (blocks.samples[where] - around.middle * light)
    guilty = np.arange(len(surplus)), np.argmax(excess * np.sign(surplus)[:, None], axis=1)
    ratio = (blocks.samples[where] / np.maximum(light, _LEAST_LIGHT))[guilty]
    low, high = around.lowest[guilty], around.highest[guilty]
    certain = np.maximum(ratio - high, low - ratio) > high - low
    certain &= (np.abs(surplus - excess[guilty]) < np.abs(surplus) / 2) & (around.known[guilty] >= _FEWEST)
    bad[where[0][certain], where[1][certain], guilty[1][certain]] = True


def _tolerance(blocks: BlockSamples, share: DoubleArray, noise: NoiseModel | None, settings: DefectSettings) -> DoubleArray:
    """How far what a block's channels add up to may be from the luminance around it, scene units."""
    tolerance = settings.contrast / 2 * (blocks.highest - blocks.lowest) + settings.floor
    if noise is None:
        return tolerance
    shot, read = np.array(noise.shot), np.array(noise.read)
    fixed = share**2 @ read[blocks.channels] ** 2 + read[-1] ** 2
    tolerance += settings.deviations * np.sqrt(fixed + shot.max() * np.maximum(blocks.light.mean(axis=2), 0))
    return tolerance


def _mended(blocks: BlockSamples, bad: BoolArray, gamma: DoubleArray) -> FloatArray:
    """What to read at the bad sites: what the block says without them, else what the blocks around do."""
    *where, site = np.nonzero(bad)
    around = _around(blocks, bad, tuple(where), 1 / float(gamma.sum()))
    each, channels = np.arange(len(site)), np.arange(len(gamma))
    light, good = blocks.light[*where], ~bad[*where]
    here, own = light[each, site], blocks.channels[site]
    of_channel = good[:, None] & (blocks.channels == channels[:, None])  # (bad sites, C, S)
    seen = of_channel.any(axis=2)
    ratio = (of_channel * blocks.samples[*where][:, None]).sum(axis=2)
    ratio /= np.maximum((of_channel * light[:, None]).sum(axis=2), _LEAST_LIGHT)
    # Eq. 7: what the other channels leave of the luminance. As doubtful as that is uneven; the blocks around, as they differ.
    others = channels != own[:, None]
    left = np.maximum(1 - (others * ratio) @ gamma, 0) / gamma[own] * here
    predicted = around.middle[each, site] * here
    doubt = ((blocks.highest - blocks.lowest)[*where] / gamma[own]) ** 2 + _LEAST_LIGHT**2
    doubt_around = ((around.highest - around.lowest)[each, site] * here) ** 2 + _LEAST_LIGHT**2
    balanced = (left * doubt_around + predicted * doubt) / (doubt + doubt_around)
    alone = np.where((seen | ~others).all(axis=1), balanced, predicted)
    return np.where(seen[each, own], ratio[each, own] * here, alone).astype(np.float32)


class _Around(NamedTuple):
    """Relative readings, sample over luminance, of each site in the blocks around some: all (blocks, S)."""

    middle: DoubleArray
    lowest: DoubleArray
    highest: DoubleArray
    known: IndexArray


def _around(blocks: BlockSamples, bad: BoolArray, where: tuple[IndexArray, ...], grey: float) -> _Around:
    """Of the blocks at `where`; without any good one around, grey."""
    ratios = np.where(bad, np.nan, blocks.samples / np.maximum(blocks.light, _LEAST_LIGHT))
    wide = np.pad(ratios, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    near = np.stack([wide[where[0] + 1 + down, where[1] + 1 + across] for down, across in _RING])
    count = (~np.isnan(near)).sum(axis=0)
    near = np.where(count > 0, near, grey)
    return _Around(np.nanmedian(near, axis=0), np.nanmin(near, axis=0), np.nanmax(near, axis=0), count)
