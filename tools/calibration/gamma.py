"""An estimate of gamma (Eq. 7) with its intervals and residuals; combining several; the test whether it is good enough."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from shared import SensorCalibration
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .assumed import SHAPES, Assumed

CONFIDENCE = 0.95
WORST_INTERVAL = 0.05  # half width over gamma: beyond it a calibration would do harm
INSTEAD = (
    "shoot a ColorChecker (or strongly coloured, evenly lit surfaces of all hues), unclipped, "
    "filling at least a quarter of the frame"
)
_VISIBLE = 3  # channels: light of three primaries has no more independent ones


def too_few_colours(channels: int) -> str:
    """Return why colours do not determine gamma of so many channels, and what to shoot instead."""
    why = "greys, or too few colours"
    if channels > _VISIBLE:
        why += f", or {channels} channels that are mixtures of fewer, as in light of three primaries (a screen, an RGB picture)"
    return f"{why}; {INSTEAD}"


@dataclass(frozen=True, eq=False)
class GammaFit:
    """An estimate of gamma from N places, and how reliable it is.

    The unknowns are gamma, an offset, and colour shading (see `unknowns`); P is their number. What the places tell of them, without
    any prior, is `information` @ unknowns = `told`; so fits are combined, and repeated with another black level.

    information: (P, P), inverse covariance.
    told: (P,).
    assumed: how far black level and shading may be off.
    calibration: its levels; its gamma is not used.
    freedom: degrees of freedom of the covariance.
    level: (N,), measured panchromatic levels, parts of full scale.
    predicted: (N,), levels that the fit predicts.
    used: (N,), False for places that were left out (clipped, outliers).
    condition: largest over smallest singular value of the colours, each divided by its level: 1 = ideal, 100 = nearly grey.
    spread: sqrt(chi2 / freedom); 1 = noise explains the residuals.
    apart: by how much independent fits contradict each other, as standard deviations of a normal number; 0 = there is only one.
    widened: by how much that widens the covariance.
    """

    information: DoubleArray
    told: DoubleArray
    assumed: Assumed
    calibration: SensorCalibration
    freedom: float
    level: DoubleArray
    predicted: DoubleArray
    used: BoolArray
    condition: float
    spread: float
    apart: float = 0.0
    widened: float = 1.0

    @cached_property
    def _solution(self) -> tuple[DoubleArray, DoubleArray]:
        return self._solved(offset=True)

    def _solved(self, *, offset: bool) -> tuple[DoubleArray, DoubleArray]:
        """Return all unknowns (P,) and their covariance (P, P); offset: see `Assumed.precision`."""
        return solved(self.information, self.told, self.assumed, self.calibration, offset=offset)

    @property
    def gamma(self) -> DoubleArray:
        """The weights of Eq. 7, (C,)."""
        return self._solution[0][: self._channels]

    @property
    def covariance(self) -> DoubleArray:
        """The covariance of gamma, (C, C)."""
        return self._solution[1][: self._channels, : self._channels] * self.widened

    @property
    def _channels(self) -> int:
        return len(self.calibration.channels)

    @property
    def offset(self) -> tuple[float, float]:
        """The panchromatic level where the channels are 0, as the places alone tell it, and its standard error; of full scale.

        The error includes that of the black level only where dark frames have measured it.
        """
        found, covariance = self._solved(offset=False)
        place = self._channels
        measured = self.assumed.black_measured
        prior = 1 / self.assumed.precision(found[:place], self.calibration)[place, place] if measured else 0.0
        return float(found[place]), float(np.sqrt(max(covariance[place, place], 0.0) * self.widened + prior))

    @property
    def off(self) -> float:
        """How many standard errors the black level seems to be off by."""
        offset, error = self.offset
        return offset / max(error, 1e-12)

    def rebased(self, black: DoubleArray) -> "GammaFit":
        """Return the fit with another black level (C + 1,), codes: a change of variables."""
        white, was = self.calibration.white_level, np.array(self.calibration.black_level)
        calibration = replace(self.calibration, black_level=tuple(black.tolist()))
        if np.array_equal(was, black):
            return replace(self, calibration=calibration)
        stretch, shift = (white - was) / (white - black), (was - black) / (white - black)
        count = self._channels
        factors = np.concatenate([stretch[-1] / stretch[:-1]] * (1 + SHAPES))
        change = np.diag([*factors[:count], stretch[-1], *factors[count:]])
        change[count, :count] = -stretch[-1] * shift[:-1] / stretch[:-1]
        back = np.linalg.inv(change)
        information = back.T @ self.information @ back
        moved = np.zeros(len(change))
        moved[count] = shift[-1]
        told = back.T @ self.told + information @ moved
        return replace(self, information=information, told=told, calibration=calibration)

    @property
    def half_width(self) -> DoubleArray:
        """Half widths of the 95 % intervals, (C,)."""
        return student.ppf((1 + CONFIDENCE) / 2, self.freedom) * np.sqrt(np.diag(self.covariance))

    @property
    def worst(self) -> float:
        """The largest relative half width."""
        return float((self.half_width / np.abs(self.gamma)).max())


def solved(
    information: DoubleArray, told: DoubleArray, assumed: Assumed, calibration: SensorCalibration, *, offset: bool = True
) -> tuple[DoubleArray, DoubleArray]:
    """Return the unknowns (P,) and their covariance (P, P) from what places tell of them, and from what is assumed."""
    gamma = np.ones(len(calibration.channels))
    found, covariance = told, information
    for _ in range(2):  # how much shading matters depends on gamma
        known = information + assumed.precision(gamma, calibration, offset=offset)
        scale = 1 / np.sqrt(np.maximum(np.diag(known), 1e-30))
        covariance = np.linalg.pinv(known * scale[:, None] * scale, hermitian=True) * scale[:, None] * scale
        found = covariance @ told
        gamma = found[: len(gamma)]
    return found, covariance


def combined(fits: Sequence[GammaFit]) -> GammaFit:
    """Combine independent fits: what they tell adds up, and what they assume counts once.

    All have the same calibration and assumptions.
    """
    if len(fits) == 1:
        return fits[0]
    best = max(fits, key=lambda fit: np.linalg.slogdet(np.linalg.inv(fit.covariance))[1])
    whole = replace(
        best,
        information=np.sum([fit.information for fit in fits], axis=0),
        told=np.sum([fit.told for fit in fits], axis=0),
        freedom=sum(fit.freedom for fit in fits),
        level=np.concatenate([fit.level for fit in fits]),
        predicted=np.concatenate([fit.predicted for fit in fits]),
        used=np.concatenate([fit.used for fit in fits]),
        condition=min(fit.condition for fit in fits),
    )
    # Fits that contradict each other in gamma beyond their intervals widen the common one (Birge's ratio). Each has its few degrees
    # of freedom, and all that it assumes: what is off in common sets them apart less than this allows.
    chi2 = 0.0
    for fit in fits:
        apart = fit.gamma - whole.gamma
        likely = student.ppf((1 + CONFIDENCE) / 2, fit.freedom) / student.ppf((1 + CONFIDENCE) / 2, np.inf)
        chi2 += float(apart @ np.linalg.solve(fit.covariance * likely**2, apart))
    freedom = len(whole.gamma) * (len(fits) - 1)
    return replace(whole, apart=_as_normal(chi2, freedom), widened=max(1.0, chi2 / freedom))


def _as_normal(chi2: float, freedom: float) -> float:
    """Return how many standard deviations of a normal number are as rare as this chi2 (E. B. Wilson, M. M. Hilferty, 1931)."""
    share = 2 / (9 * freedom)
    return float(((chi2 / freedom) ** (1 / 3) - 1 + share) / share**0.5)


def check_determined(fit: GammaFit) -> None:
    """Raise InputError that says what to shoot instead, unless every gamma is positive and known to WORST_INTERVAL."""
    if fit.gamma.min() <= 0 or fit.worst > WORST_INTERVAL:
        figures = ", ".join(f"{value:.3g} ± {half:.2g}" for value, half in zip(fit.gamma, fit.half_width, strict=True))
        raise InputError(
            f"gamma is only known to be {figures}, and {100 * WORST_INTERVAL:.0f} % are needed: {INSTEAD}; "
            "more light or more shots help too"
        )
