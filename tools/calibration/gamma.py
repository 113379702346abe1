"""An estimate of gamma (Eq. 7) with its intervals and residuals; combining several; the test whether it is good enough."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

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

    gamma: (C,), weights of Eq. 7.
    covariance: (C, C), of gamma.
    freedom: degrees of freedom of the covariance.
    level: (N,), measured panchromatic levels, parts of full scale.
    predicted: (N,), levels that gamma predicts.
    used: (N,), False for places that were left out (clipped, outliers).
    condition: largest over smallest singular value of the colours, each divided by its level: 1 = ideal, 100 = nearly grey.
    spread: sqrt(chi2 / freedom); 1 = noise explains the residuals.
    offset: panchromatic level where the channels are 0, in standard errors; beyond about 4 the black level is wrong.
    moments: (C, C + 2), of a fit with instruments Z: Z'X, Z'l and the sums of Z, from which the fit can be repeated for another
        black level. None for a chart, whose patches are kept.
    """

    gamma: DoubleArray
    covariance: DoubleArray
    freedom: int
    level: DoubleArray
    predicted: DoubleArray
    used: BoolArray
    condition: float
    spread: float
    offset: float
    moments: DoubleArray | None = None

    def rebased(self, was: DoubleArray, now: DoubleArray, white: int) -> "GammaFit":
        """Return the fit with another black level, from its moments; parameters: see `PlaceSamples.rebased`."""
        if self.moments is None:
            return self
        count = len(self.gamma)
        stretch, shift = (white - was) / (white - now), (was - now) / (white - now)
        products, total = self.moments[:, :-1], self.moments[:, -1:]
        moments = np.concatenate([products * stretch + total * shift, total], axis=1)
        return replace(self, gamma=np.linalg.lstsq(moments[:, :count], moments[:, count], rcond=None)[0], moments=moments)

    @property
    def half_width(self) -> DoubleArray:
        """Half widths of the 95 % intervals, (C,)."""
        return student.ppf((1 + CONFIDENCE) / 2, self.freedom) * np.sqrt(np.diag(self.covariance))

    @property
    def worst(self) -> float:
        """The largest relative half width."""
        return float((self.half_width / np.abs(self.gamma)).max())


def combined(fits: Sequence[GammaFit]) -> GammaFit:
    """Combine independent fits, each weighted by its information (inverse covariance)."""
    if len(fits) == 1:
        return fits[0]
    information = [np.linalg.inv(fit.covariance) for fit in fits]
    covariance = np.linalg.inv(np.sum(information, axis=0))
    gamma = covariance @ np.sum([weight @ fit.gamma for weight, fit in zip(information, fits, strict=True)], axis=0)
    joined = {name: np.concatenate([getattr(fit, name) for fit in fits]) for name in ("level", "predicted", "used")}
    # Fits that contradict each other beyond their intervals widen the common one (Birge's ratio).
    chi2 = sum(float((fit.gamma - gamma) @ weight @ (fit.gamma - gamma)) for weight, fit in zip(information, fits, strict=True))
    excess = chi2 / (len(gamma) * (len(fits) - 1))
    best = max(fits, key=lambda fit: np.linalg.slogdet(np.linalg.inv(fit.covariance))[1])
    return GammaFit(
        gamma=gamma,
        covariance=covariance * max(1.0, excess),
        freedom=sum(fit.freedom for fit in fits),
        **joined,
        condition=min(fit.condition for fit in fits),
        spread=best.spread,
        offset=max((fit.offset for fit in fits), key=abs),
    )


def check_determined(fit: GammaFit) -> None:
    """Raise InputError that says what to shoot instead, unless every gamma is positive and known to WORST_INTERVAL."""
    if fit.gamma.min() <= 0 or fit.worst > WORST_INTERVAL:
        figures = ", ".join(f"{value:.3g} ± {half:.2g}" for value, half in zip(fit.gamma, fit.half_width, strict=True))
        raise InputError(
            f"gamma is only known to be {figures}, and {100 * WORST_INTERVAL:.0f} % are needed: {INSTEAD}; "
            "more light or more shots help too"
        )
