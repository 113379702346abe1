"""The noise of a mosaic: from its calibration, or estimated from its own smooth parts, or from those of several mosaics.

Estimation looks at rows and columns that are panchromatic throughout or, where colour sites are scattered, at every second (third,
...) pixel of them. A high-pass filter along them leaves noise and texture. To leave out texture, the filtered lines are cut into
small tiles, and of tiles of similar brightness only those that vary least count. A line through their (brightness, variance) is the
Poisson-Gaussian model.
"""

from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic

from ..stage import StageSettings


@dataclass(frozen=True)
class NoiseSettings(StageSettings):
    """Where the noise model comes from.

    estimate: estimate it from the mosaic where the calibration has none. Otherwise unknown noise is treated as none (the paper).
    """

    estimate: bool = False


_FILTER = np.array([1, -4, 6, -4, 1], np.float32) / np.float32(70**0.5)  # blind to cubic shading; keeps the variance of noise
# Chosen; in brackets, by how many decibels half or twice changes crops at sigma 0.02 whose noise is unknown (README).
_LINES, _LENGTH = 8, 16  # rows and columns of a tile (0.1, 0.2)
_MOST_LINES = 2048  # lines of each direction that are looked at, for time
_CLIPPED = 0.95  # fraction of full scale above which clipping cuts noise off (0.2)
_BINS, _LEAST_TILES = 16, 20  # bins of brightness, and the least number of tiles in each (0.1, 0.2)
_SHARE = 0.1  # quantile of the variances in a bin that stands for its smooth tiles (0.2)
_NORMAL_QUANTILE = -1.2816  # that quantile of the standard normal distribution
_TEXTURED = 1.5  # times the variance of the line: a bin above it has no smooth tiles (0.3)
_ROUNDS = 4  # of leaving out such bins; two do as well


def with_noise(mosaic: Mosaic, settings: NoiseSettings) -> Mosaic:
    """The mosaic; where its calibration has no noise model, with an estimate in it if the settings ask for one."""
    if mosaic.calibration.noise is not None or not settings.estimate:
        return mosaic
    noise = estimate_noise(mosaic)
    return replace(mosaic, calibration=replace(mosaic.calibration, noise=noise and noise.possible()))


def estimate_noise(*mosaics: Mosaic) -> NoiseModel | None:
    """Estimate one noise model for all planes, scene units, from the panchromatic samples; None if the frames are too small.

    mosaics: one or more frames of one scene and sensor, whose exposures may differ. The median of their variances counts, for dark
        and for bright light: where smooth parts mislead in a few (what one clips, or what is black in one), it is not misled.

    Fine texture all over the frame counts as noise and makes the estimate too high. It is never too low by more than its scatter.
    """
    found = [line for mosaic in mosaics if (line := _fitted(mosaic))]
    if not found:
        return None
    dark, bright, slope, intercept = np.array(found).T
    if len(found) > 1 and (levels := np.array([np.median(dark), np.median(bright)]))[1] > levels[0]:
        # Of lines that rise and start at 0 or above, these medians lie on one that does too.
        variances = np.median(slope * levels[:, None] + intercept, axis=1)
        slope = np.diff(variances) / np.diff(levels)
        intercept = np.maximum(variances[0] - slope * levels[0], 0)
    planes = len(mosaics[0].pattern.planes)
    return NoiseModel((float(np.median(slope)),) * planes, (float(np.median(intercept)) ** 0.5,) * planes)


def _fitted(mosaic: Mosaic) -> tuple[float, float, float, float] | None:
    """Light of the darkest and of the brightest tiles of a frame, and slope and intercept of the line through all variances."""
    period, (height, width) = mosaic.pattern.period, mosaic.shape
    rows, columns = (mosaic.pattern.panchromatic_mask(shape) for shape in ((height, period), (period, width)))
    limit = _CLIPPED * mosaic.calibration.full_scale
    signal = mosaic.signal
    tiles = [_tiles(plane, lines, limit) for plane, lines in (*_panchromatic(signal, rows), *_panchromatic(signal.T, columns.T))]
    mean, variance = np.concatenate(tiles, axis=1)
    if mean.size < _LEAST_TILES:
        return None
    levels, variances = _quietest(mean, variance)
    return (float(levels[0]), float(levels[-1]), *_line(levels, variances))


def _panchromatic(signal: FloatArray, clear: BoolArray) -> list[tuple[FloatArray, IndexArray]]:
    """Every n-th column of a signal, for the least n with which some rows are panchromatic, and the indices of these rows.

    clear: bool (H, K), the panchromatic pixels of each row; it repeats along the row.
    """
    period = clear.shape[1]
    for step in (step for step in range(1, period + 1) if period % step == 0):
        phases = [(signal[:, phase::step], np.flatnonzero(clear[:, phase::step].all(axis=1))) for phase in range(step)]
        if any(len(lines) for _, lines in phases):
            return phases
    return []


def _tiles(signal: FloatArray, lines: IndexArray, limit: float) -> DoubleArray:
    """Mean, and variance after the high-pass filter, of tiles: float64 (2, tiles).

    lines: indices of the panchromatic rows of `signal`; a tile takes `_LINES` consecutive ones of them.
    limit: scene units; tiles that reach it are left out.
    """
    count = len(lines) // _LINES
    step = max(1, count * _LINES // _MOST_LINES)
    width = (signal.shape[1] - len(_FILTER) + 1) // _LENGTH * _LENGTH
    found = [np.empty((2, 0))]
    for tile in range(0, count * (width > 0), step):
        part = signal[lines[tile * _LINES : (tile + 1) * _LINES]]
        rest = sum(tap * part[:, start : start + width] for start, tap in enumerate(_FILTER))
        cut = (_LINES, width // _LENGTH, _LENGTH)
        light = part[:, 2 : 2 + width].reshape(cut)
        figures = np.stack([light.mean(axis=(0, 2)), np.square(rest).reshape(cut).mean(axis=(0, 2))])
        found.append(figures[:, light.max(axis=(0, 2)) < limit])
    return np.concatenate(found, axis=1).astype(np.float64)


def _quietest(mean: DoubleArray, variance: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """For each bin of brightness, its mean brightness and the variance of its smooth tiles: float64 (bins,) each."""
    # The filter's outputs along a line are not independent: this is the number of independent ones.
    overlap = np.correlate(_FILTER, _FILTER, "full").astype(np.float64)
    freedom = _LINES * _LENGTH / np.square(overlap).sum()
    # Wilson and Hilferty's approximation (1931) of that quantile of a chi-square distribution over its mean.
    below = (1 - 2 / (9 * freedom) + _NORMAL_QUANTILE * (2 / (9 * freedom)) ** 0.5) ** 3
    order = np.argsort(mean, kind="stable")
    bins = np.array_split(order, min(_BINS, mean.size // _LEAST_TILES))
    levels = np.array([mean[each].mean() for each in bins])
    return levels, np.array([np.quantile(variance[each], _SHARE) for each in bins]) / below


def _line(levels: DoubleArray, variances: DoubleArray) -> tuple[float, float]:
    """Slope and intercept, neither negative, of the line through the bins of smooth tiles: least squares of relative error."""
    expected = np.maximum(variances, np.finfo(np.float32).tiny)
    kept = np.ones(len(levels), bool)
    slope, intercept = 0.0, float(np.median(variances))
    for _ in range(_ROUNDS):
        weight = kept / expected**2
        x, y = np.average(levels, weights=weight), np.average(variances, weights=weight)
        spread = np.average((levels - x) ** 2, weights=weight)
        slope = max(float(np.average((levels - x) * (variances - y), weights=weight) / spread), 0.0) if spread > 0 else 0.0
        if (intercept := float(y - slope * x)) < 0:  # through the origin
            slope, intercept = float(np.average(levels * variances, weights=weight) / np.average(levels**2, weights=weight)), 0.0
        expected = np.maximum(slope * levels + intercept, np.finfo(np.float32).tiny)
        kept = variances <= _TEXTURED * expected
        if not kept.any():
            break
    return max(slope, 0.0), intercept
