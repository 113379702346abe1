"""An estimate of gamma (Eq. 7) with its intervals and residuals; combining several; the test whether it is good enough."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import stdtrit  # scipy.stats takes two seconds to load

from shared import SensorCalibration
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .assumed import Assumed

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
class NormalEquations:
    """What places tell of P unknowns, without any prior: `information` @ unknowns = `right_hand_side`.

    The unknowns are gamma, an offset, and colour shading (see `assumed.unknowns`). Equations of independent places add up.

    information: (P, P), inverse covariance.
    right_hand_side: (P,).
    """

    information: DoubleArray
    right_hand_side: DoubleArray

    def solved(self, assumed: Assumed, calibration: SensorCalibration, *, offset: bool = True) -> tuple[DoubleArray, DoubleArray]:
        """Return the unknowns (P,) and their covariance (P, P), also by what is assumed; offset: see `Assumed.precision`."""
        gamma = np.ones(len(calibration.channels))
        found, covariance = self.right_hand_side, self.information
        for _ in range(2):  # how much shading matters depends on gamma
            known = self.information + assumed.precision(gamma, calibration, offset=offset)
            scale = 1 / np.sqrt(np.maximum(np.diag(known), 1e-30))
            covariance = np.linalg.pinv(known * scale[:, None] * scale, hermitian=True) * scale[:, None] * scale
            found = covariance @ self.right_hand_side
            gamma = found[: len(gamma)]
        return found, covariance


@dataclass(frozen=True, eq=False)
class GammaFit:
    """An estimate of gamma from N places, and how reliable it is.

    equations: what the places tell.
    assumed: how far black level and shading may be off.
    calibration: its levels; its gamma is not used.
    freedom: degrees of freedom of the covariance.
    level: (N,), measured panchromatic levels, parts of full scale.
    predicted: (N,), levels that the fit predicts.
    used: (N,), False for places that were left out (clipped, outliers).
    condition: largest over smallest singular value of the colours, each divided by its level: 1 = ideal, 100 = nearly grey.
    spread: sqrt(chi2 / freedom); 1 = noise explains the residuals.
    contradiction: of independent fits, as standard deviations of a normal number; 0 = there is only one fit.
    widened: by how much that widens the covariance.
    """

    equations: NormalEquations
    assumed: Assumed
    calibration: SensorCalibration
    freedom: float
    level: DoubleArray
    predicted: DoubleArray
    used: BoolArray
    condition: float
    spread: float
    contradiction: float = 0.0
    widened: float = 1.0

    @cached_property
    def _solution(self) -> tuple[DoubleArray, DoubleArray]:
        return self.equations.solved(self.assumed, self.calibration)

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
        """The panchromatic level where the channels are 0, as the places alone show it, and its standard error; of full scale.

        The error includes that of the black level only where dark frames have measured it.
        """
        found, covariance = self.equations.solved(self.assumed, self.calibration, offset=False)
        place = self._channels
        measured = self.assumed.black_measured
        prior = 1 / self.assumed.precision(found[:place], self.calibration)[place, place] if measured else 0.0
        return float(found[place]), float(np.sqrt(max(covariance[place, place], 0.0) * self.widened + prior))

    @property
    def black_deviation(self) -> float:
        """How many standard errors the black level seems to be off by."""
        offset, error = self.offset
        return offset / max(error, 1e-12)

    @property
    def half_width(self) -> DoubleArray:
        """Half widths of the 95 % intervals, (C,)."""
        return stdtrit(self.freedom, (1 + CONFIDENCE) / 2) * np.sqrt(np.diag(self.covariance))

    @property
    def worst(self) -> float:
        """The largest relative half width."""
        return float((self.half_width / np.abs(self.gamma)).max())


def combined(fits: Sequence[GammaFit]) -> GammaFit:
    """Combine independent fits with the same calibration and assumptions: what they assume counts once."""
    if len(fits) == 1:
        return fits[0]
    equations = NormalEquations(
        np.sum([fit.equations.information for fit in fits], axis=0),
        np.sum([fit.equations.right_hand_side for fit in fits], axis=0),
    )
    best = max(fits, key=lambda fit: np.linalg.slogdet(np.linalg.inv(fit.covariance))[1])
    whole = replace(
        best,
        equations=equations,
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
        difference = fit.gamma - whole.gamma
        likely = stdtrit(fit.freedom, (1 + CONFIDENCE) / 2) / stdtrit(np.inf, (1 + CONFIDENCE) / 2)
        chi2 += float(difference @ np.linalg.solve(fit.covariance * likely**2, difference))
    freedom = len(whole.gamma) * (len(fits) - 1)
    return replace(whole, contradiction=_as_normal(chi2, freedom), widened=max(1.0, chi2 / freedom))


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
