"""Samples that do not measure light, known beforehand or found by how they stand out, replaced by what those around them say.

A panchromatic sample is judged by its neighbours. A colour sample has none of its kind, but it has company: what the channels of a
block read has to add up to the luminance around it (Eq. 7), and where it does not, the sample that differs from what the blocks
around predict is to blame. So texture and small bright things, which all samples of a block see, stay.

A replaced colour sample is what its block says without it, and so adds nothing to the sums of Eqs. 8-9 but its own agreement.
"""

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic

from .kernels.outliers import find_outliers, mend_panchromatic, surroundings
from .progress import SILENT, Progress
from .settings import DefectSettings

_LEAST_LIGHT = 1e-4  # scene units: darker blocks say nothing of chromaticity
_FEWEST = 3  # blocks around one, without which it cannot be judged
_MOST = 0.01  # part of the samples: where more stand out, it is the picture that is so
_RING = [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1) if down or across]


def mend_defects(mosaic: Mosaic, clipping: float, settings: DefectSettings, progress: Progress = SILENT) -> Mosaic:
    """The mosaic with defective samples replaced; itself where there is nothing to do.

    Defects are those of the calibration's list (places outside the frame are nobody's) and, blindly, single outliers.
    """
    if not settings.listed and settings.contrast == 0:
        return mosaic
    progress.stage("defects", 2)
    panchromatic = np.ascontiguousarray(mosaic.pattern.panchromatic_mask((mosaic.pattern.period,) * 2))
    bad = _listed(mosaic) if settings.listed else np.zeros(mosaic.shape, np.bool_)
    if settings.contrast:
        _find_panchromatic(mosaic, settings, panchromatic, bad)
    signal = mosaic.signal
    rows, columns = _places(bad, panchromatic)
    if len(rows):
        values = np.empty(len(rows), np.float32)
        mend_panchromatic(signal, panchromatic, bad, rows, columns, values)
        signal = signal.copy()
        signal[rows, columns] = values
    progress.advance()
    blocks = _Blocks(mosaic, signal, panchromatic, bad)
    if settings.contrast:
        blocks.find(settings, clipping)
    places, colours = blocks.mended()
    if len(colours):
        signal = signal.copy() if signal is mosaic.signal else signal
        signal[places] = colours
    progress.advance()
    return mosaic if signal is mosaic.signal else Mosaic(signal, mosaic.pattern, mosaic.calibration, mosaic.metadata)


def _listed(mosaic: Mosaic) -> BoolArray:
    bad = np.zeros(mosaic.shape, np.bool_)
    places = np.array(mosaic.calibration.defects, np.intp).reshape(-1, 2)
    places = places[(places < mosaic.shape).all(axis=1)]
    bad[places[:, 0], places[:, 1]] = True
    return bad


def _find_panchromatic(mosaic: Mosaic, settings: DefectSettings, panchromatic: BoolArray, bad: BoolArray) -> None:
    noise = mosaic.calibration.noise
    before = bad.copy()
    figures = (noise.shot[-1], noise.read[-1]) if noise else (0.0, 0.0)
    find_outliers(mosaic.signal, panchromatic, settings.contrast, settings.deviations, settings.floor, figures, bad)
    if bad.sum() - before.sum() > _MOST * bad.size:
        bad[:] = before


def _places(bad: BoolArray, panchromatic: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the bad panchromatic samples."""
    rows, columns = np.nonzero(bad)
    kept = panchromatic[rows % len(panchromatic), columns % len(panchromatic)]
    return rows[kept], columns[kept]


class _Blocks:
    """The whole blocks of a frame: what their sites read, luminance there, and which sites are bad."""

    def __init__(self, mosaic: Mosaic, signal: FloatArray, panchromatic: BoolArray, bad: BoolArray) -> None:
        pattern, grid = mosaic.pattern, mosaic.pattern.grid(mosaic.shape)
        rows, columns = grid.rows[grid.inside.any(axis=1)], grid.columns[grid.inside.any(axis=0)]
        sites = np.array(pattern.sites)
        self._rows, self._columns = (
            np.broadcast_to(places, (len(rows), len(columns), len(sites)))
            for places in (rows[:, None, None] + sites[:, 0], columns[None, :, None] + sites[:, 1])
        )
        self._channels = sites[:, 2]
        gamma = np.array(mosaic.calibration.gamma)
        self._share = (gamma / np.bincount(self._channels))[self._channels]  # of each site in what Eq. 7 adds up
        self._gamma, self._noise, self._grey = gamma, mosaic.calibration.noise, mosaic.calibration.grey
        self._samples = signal[self._rows, self._columns].astype(np.float64)
        self._bad = bad[self._rows, self._columns]
        self._light = np.empty(self._samples.shape)
        self._lowest, self._highest = np.empty(self._light.shape[:2]), np.empty(self._light.shape[:2])
        surroundings(
            signal, panchromatic, rows, columns, pattern.block_shape, sites[:, :2], self._light, self._lowest, self._highest
        )

    def find(self, settings: DefectSettings, clipping: float) -> None:
        """Add to the bad sites those that alone keep their block from adding up to its luminance."""
        missing = self._samples @ self._share - self._light @ self._share / self._gamma.sum()
        allowed = self._tolerance(settings)
        odd = (np.abs(missing) > allowed) & (self._highest < clipping) & ~self._bad.any(axis=2)
        if odd.sum() > _MOST * self._samples.size:
            return
        where = np.nonzero(odd)
        middle, lowest, highest, count = self._around(where)
        light, missing = self._light[where], missing[where][:, None]
        too_much = self._samples[where] - middle * light
        # The sample to blame explains what is missing or too much, and is outside all that the blocks around read.
        blame = np.argmax(self._share * too_much * np.sign(missing), axis=1)[:, None]
        excess, rest = (np.take_along_axis(values, blame, 1) for values in (self._share * too_much, too_much * 0))
        chroma = np.take_along_axis(self._samples[where] / np.maximum(light, _LEAST_LIGHT), blame, 1)
        low, high = np.take_along_axis(lowest, blame, 1), np.take_along_axis(highest, blame, 1)
        apart = np.maximum(chroma - high, low - chroma) > high - low
        rest = np.abs(missing - excess)
        guilty = ((np.abs(excess) > np.abs(missing) / 2) & (rest < np.abs(missing) / 2) & apart & (count >= _FEWEST))[:, 0]
        self._bad[where[0][guilty], where[1][guilty], blame[guilty, 0]] = True

    def mended(self) -> tuple[tuple[IndexArray, IndexArray], FloatArray]:
        """Frame places of the bad sites, and what to read there."""
        where = np.nonzero(self._bad)
        if len(where[0]) == 0:
            return (self._rows[where], self._columns[where]), np.empty(0, np.float32)
        middle, lowest, highest, _ = self._around(where[:2])
        site, every = where[2], np.arange(len(where[2]))
        samples, light, good = self._samples[where[:2]], self._light[where[:2]], ~self._bad[where[:2]]
        here = light[every, site]
        predicted = middle[every, site] * here
        # What the block itself says: another site of the channel, or what the other channels leave of the luminance.
        counts = np.stack([(good & (self._channels == channel)).sum(axis=1) for channel in range(len(self._gamma))], axis=1)
        chroma = np.stack(
            [
                np.where(good & (self._channels == channel), samples, 0).sum(axis=1)
                / np.maximum(np.where(good & (self._channels == channel), light, 0).sum(axis=1), _LEAST_LIGHT)
                for channel in range(len(self._gamma))
            ],
            axis=1,
        )
        own = self._channels[site]
        others = self._gamma != 0
        left = (1 - np.where(np.arange(len(self._gamma)) == own[:, None], 0, chroma * self._gamma).sum(axis=1)) / self._gamma[own]
        complete = np.where(np.arange(len(self._gamma)) == own[:, None], True, counts > 0).all(axis=1) & others.all()
        contrast = (self._highest - self._lowest)[where[:2]]
        spread = (highest - lowest)[every, site] * here
        doubt, distrust = (contrast / self._gamma[own]) ** 2 + _LEAST_LIGHT**2, spread**2 + _LEAST_LIGHT**2
        balanced = (np.maximum(left, 0) * here * distrust + predicted * doubt) / (doubt + distrust)
        values = np.where(counts[every, own] > 0, chroma[every, own] * here, np.where(complete, balanced, predicted))
        return (self._rows[where], self._columns[where]), values.astype(np.float32)

    def _tolerance(self, settings: DefectSettings) -> DoubleArray:
        """How far what a block's channels read may be from the luminance around it."""
        contrast = self._highest - self._lowest
        if self._noise is None:
            return settings.contrast / 2 * contrast + settings.floor
        shot, read = np.array(self._noise.shot), np.array(self._noise.read)
        light = np.maximum(self._light.mean(axis=2), 0)
        variance = (self._share**2 * read[self._channels] ** 2).sum() + read[-1] ** 2
        return settings.contrast / 2 * contrast + settings.deviations * np.sqrt(variance + shot.max() * light) + settings.floor

    def _around(self, where: tuple[IndexArray, ...]) -> tuple[DoubleArray, DoubleArray, DoubleArray, IndexArray]:
        """Median, least and greatest relative reading of each site in the blocks around some, (blocks, S), and how many they are.

        Without any, grey.
        """
        ratios = np.where(self._bad, np.nan, self._samples / np.maximum(self._light, _LEAST_LIGHT))
        wide = np.pad(ratios, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        near = np.stack([wide[where[0] + 1 + down, where[1] + 1 + across] for down, across in _RING])
        count = (~np.isnan(near)).sum(axis=0)
        near = np.where(count > 0, near, self._grey)
        least = count.min(axis=1)[:, None]
        return np.nanmedian(near, axis=0), np.nanmin(near, axis=0), np.nanmax(near, axis=0), least
