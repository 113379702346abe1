"""What the shots of a calibration do not measure but depend on, and how far it may be off: the black level, and colour shading.

Both disturb Eq. 7. A black level that is off adds a constant to the panchromatic level: l = gamma . c + offset. Colour shading, a
fall-off of a channel that differs from the panchromatic one, makes gamma change over the frame: gamma_i (1 + a_i(place)), with
a_i = 0 in the middle, where a calibration states it. All of these are unknowns beside gamma, with Gaussian priors: narrow if dark
and flat frames have measured them, wide if not. So intervals of gamma cover what was assumed, and shots that show the unknowns make
them narrower again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from shared import SensorCalibration
from shared.arrays import DoubleArray
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
