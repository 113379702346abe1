"""Gamma from the patches of a chart, by regression with errors in all variables.

Both sides of l = sum_i gamma_i c_i (Eq. 7) are measured with noise. Plain least squares treats the c_i as exact, and its gamma is
too small. The maximum of the likelihood over gamma and the true c_i together is the minimum over gamma alone of

    sum_j (l_j - gamma . c_j)^2 / (var l_j + sum_i gamma_i^2 var c_ij)

(W. A. Fuller, Measurement Error Models, Wiley 1987, section 3.1; physicists call it the effective variance method).
"""

import numpy as np
from scipy.optimize import least_squares

from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .gamma import INSTEAD, GammaFit, too_few_colours
from .photon_transfer import fit_photon_transfer
from .samples import PlaceSamples, robust_deviation

_WORST_CONDITION, _PER_CHANNEL = 60.0, 20.0  # the larger of both; a ColorChecker has 3 to 6, with eight narrow bands 90
_TRUST = 8.0  # weight of the noise line beside a place's own variance, in samples
_REJECT = 4.0  # standard deviations
_HUBER = 2.5
_ROUNDS = 4


def fit_chart_gamma(places: PlaceSamples) -> GammaFit:
    """Estimate gamma from the patches of one chart, for any number C of channels.

    Raises InputError that says what to shoot instead, if the patches cannot determine it: clipped, too few, too similar in colour.
    """
    channels = places.mean.shape[1] - 1
    level, colours = places.mean[:, -1], places.mean[:, :-1]
    exposed = ~places.clipped & (places.count.min(axis=1) >= 1) & (level > 0)
    least = 2 * channels
    if exposed.sum() < least:
        clipped = int(places.clipped.sum())
        why = f"{clipped} of {len(level)} patches are clipped" if clipped else f"only {int(exposed.sum())} patches can be measured"
        raise InputError(f"gamma: {why}, and {least} good ones are needed: {'expose less, or ' if clipped else ''}{INSTEAD}")
    variance = mean_variance(places, exposed)
    used = exposed
    estimate = _start(colours[used], level[used], variance[used])
    for _ in range(_ROUNDS):
        estimate = _solve(colours[used], level[used], variance[used], estimate)
        score = _score(estimate, colours, level, variance)
        scale = max(1.0, robust_deviation(score[used]))
        kept = exposed & (np.abs(score) <= _REJECT * scale)
        if kept.sum() < least or (kept == used).all():
            break
        used = kept
    score = _score(estimate, colours, level, variance)
    freedom = max(int(used.sum()) - channels, 1)
    spread = float(np.sqrt((score[used] ** 2).sum() / freedom))
    condition = float(np.linalg.cond(colours[used] / level[used, None]))
    if condition > (worst := max(_WORST_CONDITION, _PER_CHANNEL * channels)):
        raise InputError(
            f"gamma: the patches' colours are too similar (condition {condition:.0f}, at most {worst:.0f}): "
            f"{too_few_colours(channels)}"
        )
    return GammaFit(
        gamma=estimate,
        covariance=_covariance(estimate, colours[used], level[used], variance[used]) * max(spread, 1.0) ** 2,
        freedom=freedom,
        level=level,
        predicted=colours @ estimate,
        used=used,
        condition=condition,
        spread=spread,
        offset=_offset(estimate, colours[used], level[used], variance[used]) / max(spread, 1.0),
    )


def reconciled(places: PlaceSamples, gamma: DoubleArray) -> DoubleArray:
    """Return the most likely channel levels (N, C) that fulfil Eq. 7 exactly, given the measured levels and gamma."""
    variance = mean_variance(places, ~places.clipped)
    disagreement = places.mean[:, -1] - places.mean[:, :-1] @ gamma
    pull = variance[:, :-1] * gamma / _total(variance, gamma)[:, None]
    return places.mean[:, :-1] + pull * disagreement[:, None]


def mean_variance(places: PlaceSamples, exposed: BoolArray) -> DoubleArray:
    """Return the variance of each mean, (N, C + 1): the place's own, averaged with the noise line of its plane."""
    variance = np.zeros_like(places.mean)
    for plane in range(places.mean.shape[1]):
        mean, own, count = places.mean[:, plane], places.variance[:, plane], places.count[:, plane]
        line = fit_photon_transfer(mean[exposed], own[exposed], count[exposed])
        free = np.maximum(count - 1, 0)
        steady = (_TRUST * line.variance(mean) + free * own) / (_TRUST + free)
        variance[:, plane] = np.maximum(steady, 1e-14) / np.maximum(count, 1)
    return variance


def _total(variance: DoubleArray, gamma: DoubleArray) -> DoubleArray:
    """Return the variance of l - gamma . c per place, (N,)."""
    return variance[:, -1] + variance[:, :-1] @ gamma**2


def _start(colours: DoubleArray, level: DoubleArray, variance: DoubleArray) -> DoubleArray:
    weight = 1 / np.sqrt(variance.sum(axis=1))
    start, *_ = np.linalg.lstsq(colours * weight[:, None], level * weight, rcond=None)
    positive: DoubleArray = np.maximum(start, 1e-2)
    return positive


def _score(gamma: DoubleArray, colours: DoubleArray, level: DoubleArray, variance: DoubleArray) -> DoubleArray:
    return (level - colours @ gamma) / np.sqrt(_total(variance, gamma))


def _solve(colours: DoubleArray, level: DoubleArray, variance: DoubleArray, start: DoubleArray) -> DoubleArray:
    scale = max(1.0, robust_deviation(_score(start, colours, level, variance)))
    found = least_squares(
        _score, start, args=(colours, level, variance), loss="huber", f_scale=_HUBER * scale, x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    return found.x


def _covariance(gamma: DoubleArray, colours: DoubleArray, level: DoubleArray, variance: DoubleArray) -> DoubleArray:
    """Return the inverse information, from the most likely true channels: the spread of noisy ones would count as information."""
    total = _total(variance, gamma)
    likely = colours + variance[:, :-1] * gamma * ((level - colours @ gamma) / total)[:, None]
    information = (likely / total[:, None]).T @ likely
    return np.linalg.pinv(information).astype(np.float64)


def _offset(gamma: DoubleArray, colours: DoubleArray, level: DoubleArray, variance: DoubleArray) -> float:
    """Return the intercept of a fit of gamma with an intercept, in standard errors."""
    weight = 1 / np.sqrt(_total(variance, gamma))
    design = np.concatenate([colours, np.ones((len(level), 1))], axis=1) * weight[:, None]
    solution, *_ = np.linalg.lstsq(design, level * weight, rcond=None)
    return float(solution[-1] / np.sqrt(np.linalg.pinv(design.T @ design)[-1, -1]))
