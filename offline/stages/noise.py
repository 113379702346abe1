"""The noise of a mosaic: from its calibration, or estimated from its own smooth areas, or from
those of several mosaics.

The model is Poisson-Gaussian: variance = shot x signal + read^2. Rows and columns that are
panchromatic throughout or, where colour sites are scattered, every second (third, ...) pixel of
them, go through a high-pass filter, which leaves noise and texture, and are cut into small windows.
Of the windows of one bin of brightness the quietest tenth counts as smooth: its variance, over what
that quantile of a chi-square distribution is, is the noise there. The model is the line through
(brightness, variance) of the bins, by least squares of relative error; bins far above it have no
smooth windows and are left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...shared import BoolArray, DoubleArray, FloatArray, Mosaic, NoiseModel
from ..stage import StageSettings


@dataclass(frozen=True)
class NoiseSettings(StageSettings):
    """Source of the noise model.

    Attributes
    ----------
    estimate : bool
        Estimate it from the mosaic where the calibration has none. Otherwise unknown noise is
        treated as none (the paper).
    """

    estimate: bool = False


ROUNDING = 1 / 12
"""Variance that rounding adds, in codes squared."""
# blind to cubic shading; keeps the variance of noise
_FILTER = np.array([1, -4, 6, -4, 1], np.float32) / np.float32(70**0.5)
# Chosen on crops of photographs in noise that was kept secret.
_LINES, _LENGTH = 8, 16  # rows and columns of a window
_MOST_LINES = 2048  # lines of each direction that are looked at, for time
_CLIPPED = 0.95  # fraction of full scale above which clipping cuts noise off
_BINS, _LEAST_WINDOWS = 16, 20  # bins of brightness, least number of windows in each
_SHARE = 0.1  # quantile of the variances in a bin that stands for its smooth windows
_NORMAL_QUANTILE = -1.2816  # that quantile of the standard normal distribution
_TEXTURED = 1.5  # times the variance of the line: a bin above it has no smooth windows
_ROUNDS = 4  # of leaving out such bins; two do as well
# how much less variance than the frames' median a model may state: 16 times the ISO, four stops,
# explains as much
_QUIETER = 16.0


def noise_models(mosaics: Sequence[Mosaic], settings: NoiseSettings) -> list[NoiseModel | None]:
    """The noise of each frame, or of one, scene units of the frame; None = there is none, or it is
    unknown in all of them.

    A frame without a calibrated model has that of another frame. If none is calibrated, or all
    state no noise, frames of one sensitivity (ISO) share one estimate. No model states so little
    noise that its frame would take all the weight. The noise of rounding to codes is added to
    stated ones, and estimates are no less. Among frames with different channels each has its own:
    all but those like the reference are left out.
    """
    if len({mosaic.pattern.channels for mosaic in mosaics}) > 1:
        return [model for mosaic in mosaics for model in noise_models([mosaic], settings)]
    known = [mosaic.calibration.noise for mosaic in mosaics]
    is_stated = any(model and any(model.shot + model.read) for model in known)
    if settings.estimate and None in known and not is_stated:
        isos = [mosaic.metadata.iso for mosaic in mosaics]
        groups = {iso: [mosaic for mosaic in mosaics if mosaic.metadata.iso == iso] for iso in isos}
        estimates = {iso: estimate_noise(*group) for iso, group in groups.items()}
        known = [estimates[iso] for iso in isos]
    other = next((model for model in known if model), None)
    if other is None:
        return known
    models = [model or other for model in known]
    figures = np.array([(model.shot, np.square(model.read)) for model in models])  # (F, 2, planes)
    if not figures.any():  # they state that there is none
        return list(models)
    figures = np.maximum(figures, np.median(figures, axis=0) / _QUIETER)
    # calibration leaves out what rounding to codes adds
    coded = [mosaic.calibration.scale() * (mosaic.samples.dtype == np.uint16) for mosaic in mosaics]
    rounding = ROUNDING * np.square(coded)
    figures[:, 1] = figures[:, 1] + rounding if is_stated else np.maximum(figures[:, 1], rounding)
    return [NoiseModel(tuple(shot), tuple(np.sqrt(read))) for shot, read in figures.tolist()]


def estimate_noise(*mosaics: Mosaic) -> NoiseModel | None:
    """Estimate one noise model for all planes, scene units, from the panchromatic samples; None if
    the frames are too small.

    It is the sensor's noise, before the gain that undoes shading. Fine texture all over the frame
    counts as noise and makes the estimate too high. It is never too low by more than its scatter.

    Parameters
    ----------
    mosaics : Mosaic
        One or more frames of one scene and sensor, whose exposures may differ. The median of their
        variances counts, for dark and for bright light: where smooth areas mislead in a few (what
        one clips, or what is black in one), it is not misled.
    """
    fits = [fit for mosaic in mosaics if (fit := _fitted(mosaic.evenly_shaded()))]
    if not fits:
        return None
    dark, bright, slope, intercept = np.array(fits).T
    if len(fits) > 1 and (levels := np.array([np.median(dark), np.median(bright)]))[1] > levels[0]:
        # Of lines that rise and start at 0 or above, these medians lie on one that does too.
        variances = np.median(slope * levels[:, None] + intercept, axis=1)
        slope = np.diff(variances) / np.diff(levels)
        intercept = np.maximum(variances[0] - slope * levels[0], 0)
    planes = len(mosaics[0].pattern.planes)
    shot, read = float(np.median(slope)), float(np.median(intercept)) ** 0.5
    return NoiseModel((shot,) * planes, (read,) * planes)


def _fitted(mosaic: Mosaic) -> tuple[float, float, float, float] | None:
    """Light of the darkest and of the brightest windows of a frame, and slope and intercept of the
    line through all variances.
    """
    clear = mosaic.pattern.panchromatic_mask((mosaic.pattern.period,) * 2)
    limit = _CLIPPED * mosaic.calibration.full_scale
    windows = [*_windows(mosaic.signal, clear, limit), *_windows(mosaic.signal.T, clear.T, limit)]
    mean, variance = np.concatenate(windows, axis=1).astype(np.float64)
    if mean.size < _LEAST_WINDOWS:
        return None
    bins = np.array_split(np.argsort(mean, kind="stable"), min(_BINS, mean.size // _LEAST_WINDOWS))
    levels = np.array([mean[windows].mean() for windows in bins])
    # The filter's outputs along a line are not independent: this is the number of independent ones.
    correlation = np.correlate(_FILTER, _FILTER, "full").astype(np.float64)
    freedom = _LINES * _LENGTH / np.square(correlation).sum()
    # Wilson and Hilferty's approximation (1931) of that quantile of a chi-square distribution over
    # its mean.
    smooth = (1 - 2 / (9 * freedom) + _NORMAL_QUANTILE * (2 / (9 * freedom)) ** 0.5) ** 3
    variances = np.array([np.quantile(variance[windows], _SHARE) for windows in bins]) / smooth
    return (float(levels[0]), float(levels[-1]), *_line(levels, variances))


def _windows(signal: FloatArray, clear: BoolArray, limit: float) -> Iterator[FloatArray]:
    """Yield mean, and variance after the high-pass filter, of windows of panchromatic rows: float32
    (2, windows).

    Where no row is panchromatic, it takes every n-th pixel of rows, for the least n with which
    these are. clear: bool (K, K), which pixels are panchromatic. limit: scene units; windows that
    reach it are left out, and those that are black without any noise, as a mask around the picture.
    """
    yield np.empty((2, 0), np.float32)
    period = len(clear)

    def is_clear(step: int) -> bool:
        return any(clear[:, phase::step].all(axis=1).any() for phase in range(step))

    steps = (step for step in range(1, period + 1) if period % step == 0 and is_clear(step))
    step = next(steps, 0)
    for phase in range(step):
        rows = np.flatnonzero(np.resize(clear[:, phase::step].all(axis=1), len(signal)))
        plane, count = signal[:, phase::step], len(rows) // _LINES
        width = (plane.shape[1] - len(_FILTER) + 1) // _LENGTH * _LENGTH
        for window in range(0, count * (width > 0), max(1, count * _LINES // _MOST_LINES)):
            lines = plane[rows[window * _LINES : (window + 1) * _LINES]]
            high = sum(tap * lines[:, start : start + width] for start, tap in enumerate(_FILTER))
            planes = lines[:, 2 : 2 + width], high
            level, high = (plane.reshape(_LINES, -1, _LENGTH) for plane in planes)
            mean, variance = level.mean(axis=(0, 2)), np.square(high).mean(axis=(0, 2))
            shown = (level.max(axis=(0, 2)) < limit) & ((mean > 0) | (variance > 0))
            yield np.stack([mean, variance])[:, shown]


def _line(levels: DoubleArray, variances: DoubleArray) -> tuple[float, float]:
    """Slope and intercept, neither negative, of the line through the bins of smooth windows: least
    squares of relative error.
    """
    tiny, terms = np.finfo(np.float32).tiny, np.stack([levels, np.ones_like(levels)], axis=1)
    expected, smooth, line = np.maximum(variances, tiny), np.ones(len(levels), bool), terms[0]
    for _ in range(_ROUNDS):
        weight = smooth / expected
        line = np.linalg.lstsq(terms * weight[:, None], variances * weight)[0]
        if line.min() < 0:  # one of both is 0
            rest = int(line.argmax())
            term = terms[:, [rest]] * weight[:, None]
            line = np.eye(2)[rest] * np.linalg.lstsq(term, variances * weight)[0]
        expected = np.maximum(terms @ line, tiny)
        smooth = variances <= _TEXTURED * expected
        if not smooth.any():
            break
    return float(line[0]), float(line[1])
