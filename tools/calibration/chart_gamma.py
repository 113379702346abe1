"""Gamma from the patches of a chart, by regression with errors in all variables.

Both sides of l = sum_i gamma_i c_i (Eq. 7) are measured with noise. Plain least squares treats the c_i as exact, and its gamma is
too small. The maximum of the likelihood over gamma and the true c_i together is the minimum over gamma alone of

    sum_j (l_j - gamma . c_j)^2 / (var l_j + sum_i gamma_i^2 var c_ij)

(W. A. Fuller, Measurement Error Models, Wiley 1987, section 3.1; physicists call it the effective variance method).
"""

import numpy as np
from scipy.optimize import least_squares

from shared import SensorCalibration
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .gamma import INSTEAD, Assumed, GammaFit, NormalEquations, too_few_colours, unknowns
from .noise import fit_photon_transfer
from .samples import PlaceSamples, robust_deviation

_WORST_CONDITION, _PER_CHANNEL = 60.0, 20.0  # the larger of both; a ColorChecker has 3 to 6, with eight narrow bands 90
_TRUST = 8.0  # weight of the noise line beside a place's own variance, in samples
_REJECT = 4.0  # standard deviations
_HUBER = 2.5
_ROUNDS = 4


def fit_chart_gamma(places: PlaceSamples, calibration: SensorCalibration, assumed: Assumed | None = None) -> GammaFit:
    """Estimate gamma from the patches of one chart, for any number C of channels.

    places: statistics of the patches.
    calibration: of the shot; its levels are used.
    assumed: what may be off; None = nothing was measured, see `Assumed.of`.

    Raises InputError that says what to shoot instead, if the patches cannot determine it: clipped, too few, too similar in colour.
    """
    assumed = assumed or Assumed.of(calibration)
    channels = places.mean.shape[1] - 1
    level, colours = places.mean[:, -1], places.mean[:, :-1]
    exposed = ~places.clipped & (places.count.min(axis=1) >= 1) & (level > 0)
    least = 2 * channels
    if exposed.sum() < least:
        clipped = int(places.clipped.sum())
        why = f"{clipped} of {len(level)} patches are clipped" if clipped else f"only {int(exposed.sum())} patches can be measured"
        raise InputError(f"gamma: {why}, and {least} good ones are needed: {'expose less, or ' if clipped else ''}{INSTEAD}")
    problem = _Problem(level, colours, places.where, mean_variance(places, exposed))
    used, spread, freedom = exposed, 1.0, 1.0
    found = np.zeros(problem.terms.shape[1])
    found[:channels] = _start(colours[used], level[used], problem.variance[used])
    information = prior = np.zeros(0)
    for _ in range(_ROUNDS):
        prior = assumed.precision(found[:channels], calibration)
        found = problem.solved(used, found, prior, spread)
        information = problem.information(used, found) / spread**2
        score = problem.scores(found)
        freedom = max(float(used.sum() - np.trace(np.linalg.lstsq(information + prior, information, rcond=None)[0])), 1.0)
        spread = max(1.0, float(np.sqrt((score[used] ** 2).sum() / freedom)))
        kept = exposed & (np.abs(score) <= _REJECT * max(1.0, robust_deviation(score[used])))
        if kept.sum() < least or (kept == used).all():
            break
        used = kept
    information = problem.information(used, found) / spread**2
    condition = float(np.linalg.cond(colours[used] / level[used, None]))
    if condition > (worst := max(_WORST_CONDITION, _PER_CHANNEL * channels)):
        raise InputError(
            f"gamma: the patches' colours are too similar (condition {condition:.0f}, at most {worst:.0f}): "
            f"{too_few_colours(channels)}"
        )
    return GammaFit(
        equations=NormalEquations(information, (information + prior) @ found),
        assumed=assumed,
        calibration=calibration,
        freedom=freedom,
        level=level,
        predicted=problem.terms @ found,
        used=used,
        condition=condition,
        spread=float(np.sqrt((problem.scores(found)[used] ** 2).sum() / freedom)),
        where=np.zeros((1, 2)) if places.where is None else places.where.mean(axis=0, keepdims=True),
    )


class _Problem:
    """The regression of N panchromatic levels on the channels and all that disturbs them.

    level: (N,); colours: (N, C); places: see `unknowns`; variance: (N, C + 1), of the means.
    """

    def __init__(self, level: DoubleArray, colours: DoubleArray, places: DoubleArray | None, variance: DoubleArray) -> None:
        self.level, self.colours, self.places, self.variance = level, colours, places, variance
        self.terms = unknowns(colours, places)

    def scores(self, found: DoubleArray) -> DoubleArray:
        """Return the residual of each place in standard deviations, (N,)."""
        return (self.level - self.terms @ found) / np.sqrt(_total(self.variance, found[: self.colours.shape[1]]))

    def solved(self, used: BoolArray, start: DoubleArray, prior: DoubleArray, spread: float) -> DoubleArray:
        """Return the likeliest unknowns (P,), with Huber's loss for the places; prior: (P, P), diagonal."""
        strict = np.sqrt(np.diag(prior))
        assumed = strict > 0

        def missed(found: DoubleArray) -> DoubleArray:
            score = self.scores(found)[used] / spread
            large = np.abs(score) > _HUBER
            score[large] = np.sign(score[large]) * np.sqrt(2 * _HUBER * np.abs(score[large]) - _HUBER**2)
            return np.concatenate([score, (strict * found)[assumed]])

        return least_squares(missed, start, x_scale="jac", xtol=1e-12, ftol=1e-12).x

    def information(self, used: BoolArray, found: DoubleArray) -> DoubleArray:
        """Return what the places tell, (P, P), from the most likely true channels: noisy ones spread more than the true ones."""
        gamma = found[: self.colours.shape[1]]
        total = _total(self.variance, gamma)
        pull = self.variance[:, :-1] * gamma * ((self.level - self.terms @ found) / total)[:, None]
        likely = unknowns(self.colours + pull, self.places)[used]
        return (likely / total[used, None]).T @ likely


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
    return np.maximum(start, 1e-2)
