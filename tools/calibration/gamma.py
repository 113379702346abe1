"""An estimate of gamma (Eq. 7) with its intervals and residuals; combining several; the test whether it is good enough.

What shots depend on, but do not measure, is the black level and colour shading. Both disturb Eq. 7. A black level that is off adds
a constant to the panchromatic level: l = gamma . c + offset. Colour shading, a fall-off of a channel that differs from the
panchromatic one, makes gamma change over the frame: gamma_i (1 + a_i(place)), with a_i = 0 in the middle. All of these are unknowns
beside gamma, with Gaussian priors: narrow if dark and flat frames have measured them, wide if not. So intervals of gamma cover what
was assumed, and shots that show the unknowns make them narrower again. Gamma is stated for the place of the chart: only there do
colours measure it, and farther away shading that was not measured decides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.special import stdtrit  # scipy.stats takes two seconds to load

from shared import SensorCalibration
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError
from shared.figures import numbers

from .dark_frames import DarkResult

# Of the black level: OV5647 has 16 of 1024 codes and IMX219 64 (libcamera's tuning files), where 64 are assumed.
_UNKNOWN_BLACK = 0.5
_STEADY = 0.3  # codes of 12 bits: drift of black between dark frames and other shots
# Of the light, in the corners: behind its usual lens an IMX219 loses 34 % more red there, 5 % less blue (libcamera's tuning file).
_UNKNOWN_COLOUR, _UNKNOWN_TILT = 0.15, 0.02
# Of the light: flat frames may differ by as much from a smooth shading, and uneven light by as much per colour.
_KNOWN_COLOUR = 0.005
SHAPES = 4  # of colour shading: two that are round, and two that tilt
CONFIDENCE = 0.95
WORST_INTERVAL = 0.05  # half width over gamma: beyond it a calibration would do harm
INSTEAD = (
    "shoot a ColorChecker (or strongly coloured, evenly lit surfaces of all hues), unclipped, "
    "filling at least a quarter of the frame"
)
_VISIBLE = 3  # channels: light of three primaries has no more independent ones


@dataclass(frozen=True, eq=False)
class Assumed:
    """How far what was assumed, or measured by other frames, may be off (standard deviations).

    black: (C + 1,), black level, codes.
    black_measured: whether dark frames have measured it.
    colour: (C,), in the corners, share of the light by which a channel may fall off otherwise than the panchromatic samples.
    tilt: share by which it may do so from one side to the middle.
    """

    black: DoubleArray
    black_measured: bool
    colour: DoubleArray
    tilt: float

    @classmethod
    def of(
        cls,
        calibration: SensorCalibration,
        dark: DarkResult | None = None,
        measured: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
        *,
        even: bool = False,
    ) -> "Assumed":
        """What is assumed of a camera.

        calibration: with its black level.
        dark: measurement of the black level by dark frames; None = there are none.
        measured: parts of the camera that an earlier calibration has measured, as its camera file describes them.
        even: whether these frames have measured shading, if only that there is none.
        """
        steady = _STEADY * 2.0 ** (calibration.bits - 12)
        level = np.array(calibration.black_level)
        errors: DoubleArray | None = None if dark is None else dark.black_error
        if errors is None and (known_errors := measured.get("black_level", {}).get("standard_error")) is not None:
            errors = np.array(numbers("measured.black_level.standard_error", known_errors, len(level)))
        wide = np.maximum(_UNKNOWN_BLACK * level, 4 * steady)
        black = wide if errors is None else np.hypot(errors, steady)
        known = cls(black, errors is not None, np.full(len(calibration.channels), _KNOWN_COLOUR), _KNOWN_COLOUR)
        if calibration.shading:
            # A lens that dims a colour, rather than the sensor that sees less of it, dims its share of panchromatic light too. Flat
            # frames do not tell these apart, and with that share gamma itself changes towards the corners.
            *colours, panchromatic = calibration.shading.sketch
            falls = np.array([float(np.abs(panchromatic / each - 1).max()) for each in colours])
            return replace(known, colour=np.hypot(known.colour, falls))
        if even or "shading" in measured:
            return known
        return replace(known, colour=np.full_like(known.colour, _UNKNOWN_COLOUR), tilt=_UNKNOWN_TILT)

    def precision(self, gamma: DoubleArray, calibration: SensorCalibration, *, offset: bool = True) -> DoubleArray:
        """Return the inverse covariance of the unknowns, (P, P), in the order of `unknowns`.

        gamma: (C,), about.
        offset: whether the black level counts; False = nothing is assumed of it.
        """
        weights = np.append(np.abs(gamma), 1)
        span = calibration.white_level - np.array(calibration.black_level)
        # Planes may be off together or each by itself: as sums of squares or as a sum; the larger is the safer one.
        part = self.black / span * weights
        # In common, errors of the channels cancel that of the panchromatic plane in part.
        common = abs(part[-1] - part[:-1].sum())
        sides = [self.colour, self.colour, self.tilt, self.tilt]
        shapes = np.concatenate([np.maximum(np.abs(gamma), 1e-3) * side for side in sides])
        by_offset = 1 / max(common, float(np.sqrt((part**2).sum()))) ** 2 if offset else 0.0
        return np.diag([*np.zeros(len(gamma)), by_offset, *shapes**-2.0])


def unknowns(colours: DoubleArray, places: DoubleArray | None) -> DoubleArray:
    """Return the terms of the panchromatic level at N places, (N, P): colours, 1, and colours times each shape of their shading.

    colours: (N, C), levels of the channels.
    places: (N, 2), row and column from the middle of the frame, in halves of its diagonal; None = in the middle.
    """
    ones = np.ones((len(colours), 1))
    if places is None:
        return np.concatenate([colours, ones, np.zeros((len(colours), SHAPES * colours.shape[1]))], axis=1)
    square = (places**2).sum(axis=1, keepdims=True)
    shapes = (square, 4 * square * (1 - square), places[:, :1], places[:, 1:])
    return np.concatenate([colours, ones, *(colours * shape for shape in shapes)], axis=1)


def too_few_colours(channels: int) -> str:
    """Return why colours do not determine gamma of so many channels, and what to shoot instead."""
    why = "greys, or too few colours"
    if channels > _VISIBLE:
        why += f", or {channels} channels that are mixtures of fewer, as in light of three primaries (a screen, an RGB picture)"
    return f"{why}; {INSTEAD}"


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """What places tell of P unknowns, without any prior: `information` @ unknowns = `right_hand_side`.

    The unknowns are gamma, an offset, and colour shading (see `unknowns`). Equations of independent places add up.

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
    where: (M, 2), places for whose mean gamma is stated, see `unknowns`: the middle of each chart.
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
    where: DoubleArray
    contradiction: float = 0.0
    widened: float = 1.0

    @cached_property
    def _solution(self) -> tuple[DoubleArray, DoubleArray]:
        found, covariance = self.equations.solved(self.assumed, self.calibration)
        one = np.eye(self._channels)
        there = np.mean([unknowns(one, np.tile(place, (len(one), 1))) for place in self.where], axis=0)
        there[:, len(one)] = 0.0  # the offset is no part of gamma
        return there @ found, there @ covariance @ there.T

    @property
    def gamma(self) -> DoubleArray:
        """The weights of Eq. 7 at `where`, (C,)."""
        return self._solution[0]

    @property
    def covariance(self) -> DoubleArray:
        """The covariance of gamma, (C, C)."""
        return self._solution[1] * self.widened

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
        where=np.unique(np.concatenate([fit.where for fit in fits]), axis=0),
    )
    # Fits that contradict each other in gamma beyond their intervals widen the common one (Birge's ratio). Each has its few degrees
    # of freedom, and all that it assumes: what is off in common sets them apart less than this allows.
    chi2 = 0.0
    for fit in fits:
        there = replace(fit, where=whole.where)
        difference = there.gamma - whole.gamma
        likely = stdtrit(fit.freedom, (1 + CONFIDENCE) / 2) / stdtrit(np.inf, (1 + CONFIDENCE) / 2)
        chi2 += float(difference @ np.linalg.solve(there.covariance * likely**2, difference))
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
