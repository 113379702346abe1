"""How noisy a mosaic is: as its calibration says, or as its own smooth parts show.

Estimation looks at rows and columns that are panchromatic throughout (every pattern has them). A high-pass filter along them leaves
noise, and texture: so of many small tiles those count that vary least among the ones of their brightness, and a line through
(brightness, variance) is a Poisson-Gaussian model.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic

from .settings import NoiseSettings

_FILTER = np.array([1, -4, 6, -4, 1], np.float32) / np.float32(70**0.5)  # blind to cubic shading; keeps the variance of noise
_LINES, _LENGTH = 8, 16  # of a tile
_MOST_LINES = 2048  # of each direction looked at
_CLIPPED = 0.95  # of full scale: noise is cut off above
_BINS, _LEAST_TILES = 16, 20  # of brightness, and tiles in each
_SHARE = 0.1  # of the tiles of a bin that vary less than the figure taken for it
_NORMAL_QUANTILE = -1.2816  # standard deviations from the mean of a normal distribution below which that share lies
_TEXTURED = 1.5  # times the variance of the line: a bin without smooth tiles
_ROUNDS = 4


def noise_of(mosaic: Mosaic, settings: NoiseSettings) -> NoiseModel | None:
    """The calibration's noise model; where it has none, an estimate if the settings want one, otherwise None: unknown."""
    known = mosaic.calibration.noise
    return estimate_noise(mosaic) if known is None and settings.estimate else known


def estimate_noise(mosaic: Mosaic) -> NoiseModel | None:
    """The same model for all planes, scene units, from the panchromatic samples; None for a frame too small to tell.

    Fine texture all over the frame counts as noise: the estimate is too high then, never too low by more than its own scatter.
    """
    clear = mosaic.pattern.panchromatic_mask(mosaic.shape)
    limit = _CLIPPED * mosaic.calibration.full_scale
    across = _tiles(mosaic.signal, np.flatnonzero(clear.all(axis=1)), limit)
    down = _tiles(mosaic.signal.T, np.flatnonzero(clear.all(axis=0)), limit)
    mean, variance = np.concatenate([across, down], axis=1)
    if mean.size < _LEAST_TILES:
        return None
    levels, variances = _quietest(mean, variance)
    shot, read = _line(levels, variances)
    planes = len(mosaic.pattern.planes)
    return NoiseModel((shot,) * planes, (read**0.5,) * planes)


def _tiles(signal: FloatArray, lines: IndexArray, limit: float) -> DoubleArray:
    """Mean, and variance of what is left of the filter, of tiles of `lines` (rows of `signal`) that lie next to each other."""
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
    """Brightness and variance of flat tiles in bins of brightness."""
    # The filter's outputs along a line are not independent: so many are.
    overlap = np.correlate(_FILTER, _FILTER, "full").astype(np.float64)
    freedom = _LINES * _LENGTH / np.square(overlap).sum()
    # Wilson and Hilferty's approximation (1931) of that quantile of a chi-square distribution over its mean.
    below = (1 - 2 / (9 * freedom) + _NORMAL_QUANTILE * (2 / (9 * freedom)) ** 0.5) ** 3
    order = np.argsort(mean, kind="stable")
    bins = np.array_split(order, min(_BINS, mean.size // _LEAST_TILES))
    levels = np.array([mean[each].mean() for each in bins])
    return levels, np.array([np.quantile(variance[each], _SHARE) for each in bins]) / below


def _line(levels: DoubleArray, variances: DoubleArray) -> tuple[float, float]:
    """Slope and intercept, neither negative, of the line that bins of smooth tiles lie on: least squares of relative error."""
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
