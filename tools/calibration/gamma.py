"""Gamma (Eq. 7) from the patches of charts, with its interval: regression with errors in all
variables.

Both sides of l = sum_i gamma_i c_i are measured with noise. Plain least squares treats the c_i as
exact, and its gamma is too small. The maximum of the likelihood over gamma and the true c_i
together is the minimum over gamma alone of

    sum_j (l_j - gamma . c_j)^2 / (var l_j + sum_i gamma_i^2 var c_ij)

(W. A. Fuller, Measurement Error Models, Wiley 1987, section 3.1; physicists call it the effective
variance method).

Two things disturb Eq. 7 that a shot does not measure. A black level that is off adds a constant to
the panchromatic level: l = gamma . c + offset. Colour shading, a fall-off of a channel that differs
from the panchromatic one, makes gamma change over the frame: gamma_i (1 + a_i(place)), with a_i = 0
in the middle. Both are unknowns beside gamma, with Gaussian priors: narrow if dark and flat frames
have measured them, wide if not. So intervals of gamma cover what was assumed. Gamma is stated for
the place of the chart: only there do colours measure it.

Flat frames show how each plane falls off, but not why. If its own pixels see less light, Eq. 7
holds after that is undone. If the lens dims a colour, it dims that colour's share of panchromatic
light too: Eq. 7 holds before, and afterwards with gamma_i gain_w / gain_i. So a share from 0 to 1
of that change is an unknown of each channel, and gamma is stated without it: for the middle.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.special import chdtrc, huber, ndtri, stdtrit  # scipy.stats takes two seconds to load

from ...shared import BoolArray, DoubleArray, InputError, SensorCalibration
from ...shared.calibration import derived_channel
from .dark_frames import DarkResult
from .photon_transfer import fit_photon_transfer
from .places import PlaceSamples, robust_deviation

# Of the black level: OV5647 has 16 of 1024 codes and IMX219 64 (libcamera's tuning files), where 64
# are assumed.
_UNKNOWN_BLACK = 0.5
_STEADY = 0.3  # codes of 12 bits: drift of black between dark frames and other shots
# Of the light, in the corners: behind its usual lens an IMX219 loses 34 % more red there, 5 % less
# blue (libcamera's tuning file).
_UNKNOWN_COLOUR, _UNKNOWN_TILT = 0.15, 0.02
# Of the light: flat frames may differ by as much from a smooth shading, and uneven light by as much
# per colour.
_KNOWN_COLOUR = 0.005
CONFIDENCE = 0.95
WORST_INTERVAL = 0.05  # half width over gamma: beyond it a calibration would do harm
# Share by which panchromatic levels differ from Eq. 7: above the first that is said, above the
# second pictures suffer (figures in README.md).
FOLLOWS, SUFFERS = 0.005, 0.02
# with a channel that Eq. 7 defines: the colour matrix makes up for other weights; and where it does
# not hold, as other weights do nearly as well
_WORST_DERIVED = 0.2
_INSTEAD = (
    "shoot a ColorChecker (or strongly coloured, evenly lit surfaces of all hues), unclipped, "
    "filling at least a quarter of the frame"
)
# The larger of both; a ColorChecker has 3 to 6, with eight narrow bands 90.
_WORST_CONDITION, _PER_CHANNEL = 60.0, 20.0
# With these four, the 95 % intervals of random cameras cover gamma in 91 to 96 %
# (tests.benchmarks.coverage).
_TRUST = 8.0  # weight of the noise line beside a place's own variance, in samples
_REJECT, _HUBER = 4.0, 2.5  # standard deviations
_GAMMA_ROUNDS = 8
_STEADY_SHARE = 0.02  # change of what noise does not explain, from round to round
# times the variance of the noise: what an even area has at most, as few samples estimate it
_EVEN = 2.5
_UNLIKELY = 0.02  # share of the level
_BEYOND = 1.5  # times the noise: larger residuals are Eq. 7's
_WORTHWHILE = 0.6  # of the interval: what areas around a chart have to leave of it
# of its level: error of what a channel without filters is expected to see on a chart; filters are
# not those of sRGB
_EXPECTED = 0.03


class Assumed:
    """Standard deviations of what is assumed of a camera, or was measured by other frames.

    Parameters
    ----------
    calibration : SensorCalibration
        With its black level.
    dark : DarkResult | None
        Measurement of the black level by dark frames; None = there are none.
    measured : Mapping[str, Any]
        Entries of the camera file that an earlier calibration has measured, as its camera file
        describes them; shading also if these frames have measured it, if only that there is none.

    Attributes
    ----------
    calibration : SensorCalibration
        The same.
    black : DoubleArray
        (C + 1,), black level, codes.
    black_measured : bool
        Whether dark frames have measured it.
    colour : float
        In the corners, share of the light by which a channel may fall off otherwise than the
        panchromatic samples, and than known shading.
    tilt : float
        Share by which it may do so from one side to the middle.
    """

    def __init__(
        self, calibration: SensorCalibration, dark: DarkResult | None, measured: Mapping[str, Any]
    ) -> None:
        self.calibration = calibration
        drift = _STEADY * 2.0 ** (calibration.bits - 12)
        error = dark.black_error if dark else measured.get("black_level", {}).get("standard_error")
        self.black_measured = error is not None
        self.black = np.maximum(_UNKNOWN_BLACK * np.array(calibration.black_level), 4 * drift)
        if error is not None:
            self.black = np.hypot(error, drift)
        self.colour, self.tilt = _UNKNOWN_COLOUR, _UNKNOWN_TILT
        if calibration.shading or "shading" in measured:
            self.colour = self.tilt = _KNOWN_COLOUR

    def precision(self, gamma: DoubleArray, *, offset: bool = True) -> DoubleArray:
        """Return the inverse covariance of the unknowns, (P, P), in the order of `unknowns`.

        gamma: (C,), about. offset: whether the black level counts; False = nothing is assumed of
        it.
        """
        weights = np.append(np.abs(gamma), 1)
        span = self.calibration.white_level - np.array(self.calibration.black_level)
        # Planes may be off together or each by itself: as sums of squares or as a sum; the larger
        # is the safer one.
        errors = self.black / span * weights
        # In common, errors of the channels cancel that of the panchromatic plane in part.
        common = abs(errors[-1] - errors[:-1].sum())
        black = 1 / max(common, float(np.sqrt((errors**2).sum()))) ** 2 if offset else 0.0
        sides = np.array([[self.colour], [self.colour], [self.tilt], [self.tilt], [1.0]])
        shading = (np.maximum(np.abs(gamma), 1e-3) * sides) ** -2.0
        return np.diag(np.concatenate([np.zeros(len(gamma)), [black], shading.ravel()]))


def unknowns(colours: DoubleArray, where: DoubleArray, dimming: DoubleArray | float) -> DoubleArray:
    """Return what each unknown adds to the panchromatic level at N places, (N, P).

    The unknowns are gamma, (C,), an offset, and shading of each channel, C each: in two shapes that
    are round, two that tilt, and that of flat frames, if it is in the light.

    Parameters
    ----------
    colours : DoubleArray
        (N, C), levels of the channels.
    where : DoubleArray
        (N, 2), row and column from the middle of the frame, in halves of its diagonal; or (1, 2),
        one place of all.
    dimming : DoubleArray | float
        (N, C), see `PlaceSamples`; half of it, and more or less as the unknown says.
    """
    where = np.broadcast_to(where, (len(colours), 2))
    square = (where**2).sum(axis=1, keepdims=True)
    shapes = (square, 4 * square * (1 - square), where[:, :1], where[:, 1:], dimming / 2)
    one = np.ones((len(colours), 1))
    terms = colours * (1 + dimming / 2), one, *(colours * shape for shape in shapes)
    return np.concatenate(terms, axis=1)


@dataclass(frozen=True, eq=False)
class GammaFit:
    """An estimate of gamma from N places, and how reliable it is.

    The unknowns are gamma, an offset, and colour shading, P in all (see `unknowns`). Without any
    prior the places tell `information` @ unknowns = `right_hand_side`; such equations of
    independent places add up.

    Attributes
    ----------
    information : DoubleArray
        (P, P), inverse covariance.
    right_hand_side : DoubleArray
        (P,).
    assumed : Assumed
        How far black level and shading may be off.
    freedom : float
        Degrees of freedom of the covariance.
    predicted : DoubleArray
        (N,), panchromatic levels that the fit predicts, parts of full scale.
    used : BoolArray
        (N,), False for places that were left out (clipped, outliers).
    condition : float
        Largest over smallest singular value of the colours, each divided by its level: 1 = ideal,
        100 = nearly grey.
    spread : float
        Sqrt(chi2 / freedom); 1 = noise explains the residuals.
    where : DoubleArray
        (M, 2), places for whose mean gamma is stated, see `unknowns`: the middle of each chart.
    around : int
        Number of areas around the chart among the N places; `predicted` and `used` are of the
        patches alone.
    unexplained : float
        Standard deviation of the panchromatic level from what Eq. 7 says, beyond noise, as a share.
    contradiction : float
        Of independent fits, as standard deviations of a normal number; 0 = there is only one fit.
    widened : float
        By how much that widens the covariance.
    limit : float
        Half width over gamma beyond which a calibration would do harm.
    bend : tuple[float, float]
        By how much levels at full scale are off a linear response, as a share, and by how many
        standard errors that explains the places better than a wrong black level.
    """

    information: DoubleArray
    right_hand_side: DoubleArray
    assumed: Assumed
    freedom: float
    predicted: DoubleArray
    used: BoolArray
    condition: float
    spread: float
    where: DoubleArray
    around: int = 0
    unexplained: float = 0.0
    contradiction: float = 0.0
    widened: float = 1.0
    limit: float = WORST_INTERVAL
    bend: tuple[float, float] = (0.0, 0.0)

    def _solved(self, *, offset: bool = True) -> tuple[DoubleArray, DoubleArray]:
        """Return the unknowns (P,) and their covariance (P, P), also by what is assumed; offset:
        see `Assumed.precision`.
        """
        gamma = np.ones(len(self.assumed.calibration.channels))
        solution, covariance = self.right_hand_side, self.information
        for _ in range(2):  # how much shading matters depends on gamma
            posterior = self.information + self.assumed.precision(gamma, offset=offset)
            root = 1 / np.sqrt(np.maximum(np.diag(posterior), 1e-30))
            scale = np.outer(root, root)
            covariance = np.linalg.pinv(posterior * scale, hermitian=True) * scale
            solution = covariance @ self.right_hand_side
            gamma = solution[: len(gamma)]
        return solution, covariance

    @cached_property
    def _at_charts(self) -> tuple[DoubleArray, DoubleArray]:
        solution, covariance = self._solved()
        one = np.eye(len(self.assumed.calibration.channels))
        terms = np.mean([unknowns(one, place[None], 0.0) for place in self.where], axis=0)
        terms[:, len(one)] = 0.0  # the offset is no part of gamma
        return terms @ solution, terms @ covariance @ terms.T

    @property
    def gamma(self) -> DoubleArray:
        """The weights of Eq. 7 at `where`, (C,)."""
        return self._at_charts[0]

    @property
    def covariance(self) -> DoubleArray:
        """The covariance of gamma, (C, C)."""
        return self._at_charts[1] * self.widened

    @cached_property
    def offset(self) -> tuple[float, float]:
        """The panchromatic level where the channels are 0, as the places alone show it, and its
        standard error; of full scale.

        The error includes that of the black level only where dark frames have measured it.
        """
        solution, covariance = self._solved(offset=False)
        place = len(self.assumed.calibration.channels)
        prior = self.assumed.precision(solution[:place])[place, place]
        black = self.assumed.black_measured / prior
        variance = max(covariance[place, place], 0.0) * self.widened + black
        return float(solution[place]), float(np.sqrt(variance))

    @property
    def black_deviation(self) -> float:
        """Error of the black level in standard errors."""
        offset, error = self.offset
        return offset / max(error, 1e-12)

    @property
    def half_width(self) -> DoubleArray:
        """Half widths of the 95 % intervals, (C,)."""
        return stdtrit(self.freedom, (1 + CONFIDENCE) / 2) * np.sqrt(np.diag(self.covariance))

    @property
    def words(self) -> str:
        """Gamma of each channel with its interval, for people."""
        pairs = zip(self.gamma, self.half_width, strict=True)
        return ", ".join(f"{value:.3g} ± {half:.2g}" for value, half in pairs)

    @property
    def worst(self) -> float:
        """The largest relative half width."""
        return float((self.half_width / np.abs(self.gamma)).max())

    @property
    def follows(self) -> bool:
        """True if the panchromatic level nearly follows from the channels."""
        return self.unexplained <= FOLLOWS

    @property
    def fault(self) -> str:
        """A sentence on what to shoot instead unless every gamma is positive and known to `limit`;
        "" if it is.
        """
        if self.gamma.min() > 0 and self.worst <= self.limit:
            return ""
        known = f"gamma is only known to be {self.words}, and {100 * self.limit:.0f} % are needed"
        return f"{known}: {_INSTEAD}; more light or more shots help too"


def fit_gamma(
    places: PlaceSamples, assumed: Assumed, patches: int | None = None, *, offset: bool = True
) -> GammaFit:
    """Estimate gamma from the patches of one chart, for any number C of channels.

    Raises InputError: the patches cannot determine gamma: clipped, too few, too similar in colour.
    It says what to shoot instead.

    Parameters
    ----------
    places
        Statistics of the patches.
    assumed
        What may be off.
    patches
        How many of the places are patches, the first ones; None = all. Others only add to what
        these tell.
    offset
        Whether the black level that is assumed counts while outliers are sought. It does not if the
        patches contradict it: the dark ones, which tell how far it is off, would be left out.
    """
    channels = places.mean.shape[1] - 1
    level, colours = places.mean[:, -1], places.mean[:, :-1]
    exposed = places.exposed & (level > 0)
    least, lit = 2 * channels, int(exposed.sum())
    if lit < least:
        found = f"{lit} of {len(level)} patches are lit and not clipped, and {least} are needed"
        raise InputError(f"gamma: {found}: change the exposure, or {_INSTEAD}")
    problem = _Problem(places, mean_variance(places, exposed))
    used, spread, freedom = exposed, 1.0, 1.0
    solution, believed = problem.start(used), np.zeros(0)
    for _ in range(_GAMMA_ROUNDS):
        prior = assumed.precision(solution[:channels])
        believed = assumed.precision(solution[:channels], offset=offset)
        solution = problem.solve(used, solution, believed, spread)
        information = problem.information(used, solution) / spread**2
        # the share of each unknown that the places determine
        determined, *_ = np.linalg.lstsq(information + prior, information, rcond=None)
        freedom = max(float(used.sum() - np.trace(determined)), 1.0)
        before = problem.unexplained
        problem.unexplained = problem.beyond_noise(used, solution, freedom)
        score = problem.scores(solution)
        spread = max(1.0, float(np.sqrt((score[used] ** 2).sum() / freedom)))
        kept = exposed & (np.abs(score) <= _REJECT * max(1.0, robust_deviation(score[used])))
        steady = abs(problem.unexplained - before) <= _STEADY_SHARE * before
        if kept.sum() < least or (steady and (kept == used).all()):
            break
        used = kept
    information = problem.information(used, solution) / spread**2
    of_chart = np.flatnonzero(used[:patches])
    condition = float(np.linalg.cond(colours[of_chart] / level[of_chart, None]))
    if condition > (worst := max(_WORST_CONDITION, _PER_CHANNEL * channels)):
        much = f"condition {condition:.0f}, at most {worst:.0f}"
        why = f"the patches' colours are too similar ({much}), or the light has fewer primaries"
        raise InputError(f"gamma: {why} than the sensor channels; {_INSTEAD}")
    fit = GammaFit(
        information=information,
        right_hand_side=(information + believed) @ solution,
        assumed=assumed,
        freedom=freedom,
        predicted=(problem.terms @ solution)[:patches],
        used=used[:patches],
        condition=condition,
        spread=float(np.sqrt((problem.scores(solution)[used] ** 2).sum() / freedom)),
        where=places.where[:patches].mean(axis=0, keepdims=True),
        around=len(level) - len(level[:patches]),
        bend=problem.bend(exposed, solution[:channels], assumed),
        unexplained=problem.unexplained,
        limit=_WORST_DERIVED if problem.unexplained > FOLLOWS else WORST_INTERVAL,
    )
    if offset and (abs(fit.black_deviation) > _REJECT or fit.spread > _HUBER):
        return fit_gamma(places, assumed, patches, offset=False)
    return fit


def with_surroundings(fit: GammaFit, chart: PlaceSamples, around: PlaceSamples) -> GammaFit:
    """Return the fit to the patches of a chart and to even areas around it, if that nearly halves
    the interval; otherwise the fit to the patches alone.

    Even areas without clipped samples obey Eq. 7 as patches do. Areas that move gamma out of the
    interval of the chart do not: reflections, or a texture finer than the pattern. Where the chart
    does not obey Eq. 7 either, areas of one colour differ from it alike, and tell little.

    fit: to the patches. chart, around: statistics of the patches, and of areas of their size.
    """
    if fit.unexplained:
        return fit
    even = ~around.clipped
    for plane in range(around.mean.shape[1]):
        of_chart = (chart.mean, chart.variance, chart.count)
        line = fit_photon_transfer(*(values[fit.used, plane] for values in of_chart))
        even &= around.variance[:, plane] <= _EVEN * line.variance(around.mean[:, plane])
    wider = fit_gamma(chart.joined(around, even), fit.assumed, len(chart.mean))
    agrees = (np.abs(wider.gamma - fit.gamma) <= fit.half_width).all()
    return wider if agrees and wider.worst <= _WORTHWHILE * fit.worst else fit


def fit_with_derived(
    places: PlaceSamples, assumed: Assumed, derived: int, expected: DoubleArray
) -> tuple[GammaFit, PlaceSamples]:
    """Estimate gamma where one channel has no filter, and return the levels of that channel, too.

    It is what panchromatic samples read beyond the others, (l - sum_i gamma_i c_i) / gamma_d, so
    that only the chart tells what it should see. Its unit is free: gamma_d is the mean of the
    others, whatever the light.

    Raises InputError as `fit_gamma`.

    Parameters
    ----------
    places
        Statistics of the patches; what they say of this channel is not used.
    derived
        The channel, see `CfaPattern.derived`.
    expected
        (N,), what it should see of each patch, in any unit.
    """

    def with_levels(level: DoubleArray, variance: DoubleArray) -> PlaceSamples:
        mean, spread, count = places.mean.copy(), places.variance.copy(), places.count.copy()
        mean[:, derived], spread[:, derived], count[:, derived] = level, variance, 1
        return replace(places, mean=mean, variance=spread, count=count)

    for _ in range(2):
        error = _EXPECTED * (np.abs(expected) + _EXPECTED * expected.max())
        fit = fit_gamma(with_levels(expected, error**2), assumed)
        others = np.delete(fit.gamma, derived)
        unit = float(fit.gamma[derived] / others.mean())
        expected = expected * unit
    gamma = np.insert(others, derived, others.mean())
    level = derived_channel(places.mean[:, -1], places.mean[:, :-1], gamma, derived)
    variance = places.variance[:, -1] / others.mean() ** 2
    return replace(fit, limit=_WORST_DERIVED, bend=(0.0, 0.0)), with_levels(level, variance)


class _Problem:
    """The regression of N panchromatic levels on the channels and all that disturbs them.

    variance: (N, C + 1), of the means.
    """

    def __init__(self, places: PlaceSamples, variance: DoubleArray) -> None:
        self.level, self.colours = places.mean[:, -1], places.mean[:, :-1]
        self.places, self.variance = places, variance
        # Share of the panchromatic level that does not follow from Eq. 7. Beginning with much of it
        # no patch is right because it is bright.
        self.unexplained = _UNLIKELY
        self.terms = unknowns(self.colours, places.where, places.dimming)

    def start(self, used: BoolArray) -> DoubleArray:
        """Return unknowns (P,) to begin with: gamma by weighted least squares, 0 for the others."""
        colours, level = self.colours[used], self.level[used]
        weight = 1 / np.sqrt(self.variance[used].sum(axis=1))
        gamma, *_ = np.linalg.lstsq(colours * weight[:, None], level * weight, rcond=None)
        return np.pad(np.maximum(gamma, 1e-2), (0, self.terms.shape[1] - gamma.size))

    def scores(self, solution: DoubleArray) -> DoubleArray:
        """Return the residual of each place in standard deviations, (N,)."""
        return (self.level - self.terms @ solution) / np.sqrt(self.total(solution))

    def total(self, solution: DoubleArray) -> DoubleArray:
        """Return the variance of each residual, (N,)."""
        noise = _total(self.variance, solution[: self.colours.shape[1]])
        return noise + (self.unexplained * self.level) ** 2

    def beyond_noise(self, used: BoolArray, solution: DoubleArray, freedom: float) -> float:
        """Return the share of the level by which patches differ from Eq. 7, so that with the noise
        it explains the residuals; 0 if noise nearly does.
        """
        residual = (self.level - self.terms @ solution)[used]
        noise = _total(self.variance, solution[: self.colours.shape[1]])[used]

        def excess(share: float) -> float:
            scores = residual / np.sqrt(noise + (share * self.level[used]) ** 2)
            return float(np.sqrt((np.minimum(scores**2, _HUBER**2)).sum() / freedom)) - 1

        if excess(0) < _BEYOND - 1:
            return 0.0
        return float(brentq(excess, 0, 1e3, xtol=1e-6))

    def solve(
        self, used: BoolArray, start: DoubleArray, prior: DoubleArray, spread: float
    ) -> DoubleArray:
        """Return the likeliest unknowns (P,), with Huber's loss for the places; prior: (P, P),
        diagonal.
        """
        precision = np.sqrt(np.diag(prior))

        def residuals(solution: DoubleArray) -> DoubleArray:
            score = self.scores(solution)[used] / spread
            score = np.sign(score) * np.sqrt(2 * huber(_HUBER, score))
            return np.concatenate([score, (precision * solution)[precision > 0]])

        return least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12).x

    def bend(self, used: BoolArray, gamma: DoubleArray, assumed: Assumed) -> tuple[float, float]:
        """Return `GammaFit.bend`: l + bend l^2 for each l in Eq. 7, beside other unknowns."""
        column = self.level**2 - self.colours**2 @ gamma
        weight, solution = 1 / np.sqrt(_total(self.variance, gamma)), gamma
        chi2: list[float] = []
        for offset, more in ((True, 0.0), (False, 0.0), (True, 1.0)):
            root = np.sqrt(assumed.precision(gamma, offset=offset))
            terms = np.column_stack([self.terms, more * column]) * weight[:, None]
            rows = np.concatenate([terms[used], np.pad(root, ((0, 0), (0, 1)))])
            target = np.pad((self.level * weight)[used], (0, len(root)))
            solution = np.linalg.lstsq(rows, target, rcond=None)[0]
            chi2.append(float(np.square(rows @ solution - target).sum()))
        noise = max(chi2[2] / max(int(used.sum()) - gamma.size - 2, 1), 1.0)
        return float(solution[-1]), max((min(chi2[:2]) - chi2[2]) / noise, 0.0) ** 0.5

    def information(self, used: BoolArray, solution: DoubleArray) -> DoubleArray:
        """Return what the places tell, (P, P), from the most likely true channels: noisy ones
        spread more than the true ones.
        """
        gamma, total = solution[: self.colours.shape[1]], self.total(solution)
        residual = (self.level - self.terms @ solution) / total
        pull = self.variance[:, :-1] * gamma * residual[:, None]
        likely = unknowns(self.colours + pull, self.places.where, self.places.dimming)[used]
        return (likely / total[used, None]).T @ likely


def reconciled(places: PlaceSamples, gamma: DoubleArray) -> DoubleArray:
    """Return the most likely channel levels (N, C) that fulfil Eq. 7 exactly, given the measured
    levels and gamma.
    """
    variance = mean_variance(places, places.exposed)
    disagreement = places.mean[:, -1] - places.mean[:, :-1] @ gamma
    pull = variance[:, :-1] * gamma / _total(variance, gamma)[:, None]
    return places.mean[:, :-1] + pull * disagreement[:, None]


def mean_variance(places: PlaceSamples, exposed: BoolArray) -> DoubleArray:
    """Return the variance of each mean, (N, C + 1): the place's own, averaged with the noise line
    of its plane.
    """
    variance = np.zeros_like(places.mean)
    for plane in range(places.mean.shape[1]):
        mean, own, count = places.mean[:, plane], places.variance[:, plane], places.count[:, plane]
        if count.max() <= 1:  # what a channel without filters is expected to see
            variance[:, plane] = own
            continue
        line = fit_photon_transfer(mean[exposed], own[exposed], count[exposed])
        free = np.maximum(count - 1, 0)
        steady = (_TRUST * line.variance(mean) + free * own) / (_TRUST + free)
        variance[:, plane] = np.maximum(steady, 1e-14) / np.maximum(count, 1)
    return variance


def _total(variance: DoubleArray, gamma: DoubleArray) -> DoubleArray:
    """Return the variance of l - gamma . c per place, (N,)."""
    return variance[:, -1] + variance[:, :-1] @ gamma**2


def combined(fits: Sequence[GammaFit]) -> GammaFit:
    """Combine independent fits with the same calibration and assumptions: what they assume counts
    once. Levels and residuals remain those of the first.
    """
    if len(fits) == 1:
        return fits[0]
    # What Eq. 7 does not explain is the same in all shots of a chart.
    unexplained = max(fit.unexplained for fit in fits)
    times = len(fits) if unexplained else 1
    joined = replace(
        fits[0],
        information=np.sum([fit.information for fit in fits], axis=0) / times,
        right_hand_side=np.sum([fit.right_hand_side for fit in fits], axis=0) / times,
        freedom=sum(fit.freedom for fit in fits) / times,
        unexplained=unexplained,
        limit=max(fit.limit for fit in fits),
        bend=max((fit.bend for fit in fits), key=lambda bend: bend[1]),
        around=sum(fit.around for fit in fits),
        condition=min(fit.condition for fit in fits),
        spread=max(fit.spread for fit in fits),
        where=np.concatenate([fit.where for fit in fits]),
    )
    # Fits that contradict each other in gamma beyond their intervals widen the common one (Birge's
    # ratio). Each has its few degrees of freedom, and all that it assumes: what is off in common
    # sets them apart less than this allows.
    chi2 = 0.0
    for fit in fits:
        there = replace(fit, where=joined.where)
        difference = there.gamma - joined.gamma
        wider = stdtrit(fit.freedom, (1 + CONFIDENCE) / 2) / ndtri((1 + CONFIDENCE) / 2)
        chi2 += float(difference @ np.linalg.solve(there.covariance * wider**2, difference))
    freedom = len(joined.gamma) * (len(fits) - 1)
    rare = max(float(chdtrc(freedom, chi2)), 1e-300)  # so that it is 37 deviations at most
    return replace(joined, contradiction=-float(ndtri(rare)), widened=max(1.0, chi2 / freedom))
