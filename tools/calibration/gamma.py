"""What is known of gamma (Eq. 7): estimate, intervals, residuals; how several shots add up, and when it is not enough."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

CONFIDENCE = 0.95
WORST_INTERVAL = 0.05  # half width over gamma: past it a calibration would do harm
INSTEAD = (
    "shoot a ColorChecker (or strongly coloured, evenly lit surfaces of all hues), unclipped, "
    "filling at least a quarter of the frame"
)


@dataclass(frozen=True, eq=False)
class GammaFit:
    """gamma with what tells how far to trust it.

    gamma: (C,); covariance: (C, C); freedom: degrees of freedom behind the covariance.
    level, predicted: (N,), panchromatic level of each place as measured and as gamma says, parts of full scale; score: (N,), their
    difference in standard deviations; used: (N,), False for places left out (clipped, outliers).
    condition: largest over smallest singular value of the colours used, each divided by its level: 1 = ideal, 100 = nearly grey.
    spread: sqrt(chi2 / freedom): 1 when noise explains the residuals.
    offset: panchromatic level where the channels are 0, in standard errors; beyond some 4 the black level is wrong.
    """

    gamma: DoubleArray
    covariance: DoubleArray
    freedom: int
    level: DoubleArray
    predicted: DoubleArray
    score: DoubleArray
    used: BoolArray
    condition: float
    spread: float
    offset: float

    @property
    def half_width(self) -> DoubleArray:
        """Of the 95 % intervals, (C,)."""
        return student.ppf((1 + CONFIDENCE) / 2, self.freedom) * np.sqrt(np.diag(self.covariance))

    @property
    def worst(self) -> float:
        """The largest half width over its gamma."""
        return float((self.half_width / np.abs(self.gamma)).max())


def combined(fits: Sequence[GammaFit]) -> GammaFit:
    """Independent fits as one, each counting by its information (inverse covariance)."""
    if len(fits) == 1:
        return fits[0]
    information = [np.linalg.inv(fit.covariance) for fit in fits]
    covariance = np.linalg.inv(np.sum(information, axis=0))
    gamma = covariance @ np.sum([weight @ fit.gamma for weight, fit in zip(information, fits, strict=True)], axis=0)
    # Fits that contradict each other beyond their intervals widen the common one (Birge's ratio).
    apart = sum(float((fit.gamma - gamma) @ weight @ (fit.gamma - gamma)) for weight, fit in zip(information, fits, strict=True))
    excess = apart / (len(gamma) * (len(fits) - 1))
    best = max(fits, key=lambda fit: np.linalg.slogdet(np.linalg.inv(fit.covariance))[1])
    return GammaFit(
        gamma=gamma,
        covariance=covariance * max(1.0, excess),
        freedom=sum(fit.freedom for fit in fits),
        level=np.concatenate([fit.level for fit in fits]),
        predicted=np.concatenate([fit.predicted for fit in fits]),
        score=np.concatenate([fit.score for fit in fits]),
        used=np.concatenate([fit.used for fit in fits]),
        condition=min(fit.condition for fit in fits),
        spread=best.spread,
        offset=max((fit.offset for fit in fits), key=abs),
    )


def check_determined(fit: GammaFit) -> None:
    """Raise InputError, saying what to shoot instead, unless every gamma is positive and known to WORST_INTERVAL."""
    if fit.gamma.min() <= 0 or fit.worst > WORST_INTERVAL:
        figures = ", ".join(f"{value:.3g} ± {half:.2g}" for value, half in zip(fit.gamma, fit.half_width, strict=True))
        raise InputError(
            f"gamma is determined no better than {figures}, and {100 * WORST_INTERVAL:.0f} % are needed: {INSTEAD}; "
            "more light or more shots help too"
        )
