"""What an HDR display adds to a picture: highlights beyond display white, as a map of gains (ISO 21496-1).

A picture ends at display white: the brightest that every channel can measure. The render knows more: a colour sample saturates
later than the panchromatic ones, later still in a channel in which white reads less, and `offline/highlights.py` rebuilds light
up to the channel that clips last. An HDR display shows it up to there, `headroom` times display white. Where nothing is clipped
the gain is 1, and the picture is the same on every display.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import log2

import numpy as np

from shared import SensorCalibration
from shared.arrays import ByteArray, FloatArray, strips
from shared.display import ColourTransform

OFFSET = 1 / 64
"""What is added to both pictures before their ratio is taken: the gain of black stays finite."""

_NEUTRAL, _TOP = 64, 255  # codes of gain 1, and of the highest; a JPEG keeps even areas of 64 exactly
_LEAST = 1  # stops: less range than this is no HDR


@dataclass(frozen=True)
class GainMap:
    """How the gains of one sensor's pictures are coded: the same for all pictures of a kind, whatever is in them.

    shown: the transform of the picture that the gains belong to.
    full_scale: scene units at which a colour sample saturates.
    exposure: gain of the picture, stops.
    """

    shown: ColourTransform
    full_scale: float
    exposure: float = 0.0

    @classmethod
    def of(cls, calibration: SensorCalibration, space: str, exposure: float = 0.0) -> "GainMap":
        """The gains of a sensor's pictures in a space that is not linear. Raises InputError as `ColourTransform.to_space` does."""
        return cls(ColourTransform.to_space(calibration, space), calibration.full_scale, exposure)

    @cached_property
    def headroom(self) -> float:
        """The brightest light that is shown, in units of display white."""
        return max(self.full_scale / min(self.shown.white), float(2**_LEAST))

    @property
    def highest(self) -> float:
        """The highest gain, stops: from display white, or from the white that a positive exposure clips."""
        return log2(self.headroom) + max(self.exposure, 0.0)

    @property
    def lowest(self) -> float:
        """The lowest gain, stops: a highlight of a saturated colour has less of the other channels than its clipped picture."""
        return -self.highest * _NEUTRAL / (_TOP - _NEUTRAL)

    @property
    def capacity(self) -> float:
        """How much brighter than white a display has to be to show all, stops."""
        return max(log2(self.headroom) + self.exposure, _LEAST)

    def codes(self, rgb: FloatArray) -> ByteArray:
        """The gains of a rendering in scene units, (H, W, C), for each channel of the picture: uint8 (H, W, 3)."""
        linear = replace(self.shown, space=replace(self.shown.space, linear=True))
        white = np.array(self.shown.white, np.float32)
        steps = np.float32((_TOP - _NEUTRAL) / self.highest)
        result = np.full((*rgb.shape[:2], 3), _NEUTRAL, np.uint8)
        for rows in strips(len(rgb)):
            light = linear.apply(rgb[rows].clip(-white, white * np.float32(self.headroom)), self.exposure)
            bright = (rgb[rows] > white).any(axis=2) | (light > 1).any(axis=2)
            if not bright.any():
                continue
            clipped = linear.apply(rgb[rows][bright][None].clip(-white, white), self.exposure)[0].clip(0, 1)
            gains = np.log2((light[bright].clip(0, None) + np.float32(OFFSET)) / (clipped + np.float32(OFFSET)))
            result[rows][bright] = np.rint(_NEUTRAL + steps * gains).clip(0, _TOP)
        return result
