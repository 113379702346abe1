"""What an HDR display adds to a picture: highlights beyond display white, as a map of gains (ISO 21496-1).

A picture ends at display white: the brightest that every channel can measure. The render knows more: a colour sample saturates
later than the panchromatic ones, later still in a channel in which white reads less, and `offline/highlights.py` rebuilds light
up to the channel that clips last. An HDR display shows it up to there, `headroom` times display white. Where nothing is clipped
the gain is 1, and the picture is the same on every display. So it is where a picture is darkened and what is burnt out is white.

The gain is that of luminance, the same for all channels. Beyond display white some channel may be clipped, in the sensor or in
the picture that was simulated, and the colour is unknown (`shared/display.py`): the colour of a highlight stays that of the
picture, or a burnt-out lamp that the picture shows white would be magenta in HDR.
"""

from dataclasses import dataclass, replace
from math import log2

import numpy as np

from shared.arrays import ByteArray, FloatArray, strips
from shared.display import ColourTransform

OFFSET = 1 / 64
"""What is added to both pictures before their ratio is taken: the gain of black stays finite."""

_TOP = 255  # the highest code: of a gain, where that of 1 is 0, and of the picture
_LEAST = 1  # stops: less range than this is no HDR


@dataclass(frozen=True)
class GainMap:
    """How the gains of one sensor's pictures are coded: the same for all pictures of a kind, whatever is in them.

    shown: the transform of the picture that the gains belong to.
    exposure: gain of the picture, stops.
    """

    shown: ColourTransform
    exposure: float = 0.0

    @property
    def headroom(self) -> float:
        """The brightest light that is shown, in units of display white."""
        return max(self.shown.brightest, float(2**_LEAST))

    @property
    def highest(self) -> float:
        """The highest gain, stops: from the white of the picture to the brightest light."""
        return max(log2(self.headroom) + self.exposure, float(_LEAST))

    def capacity(self, brightest: int) -> float:
        """How much brighter than white a display has to be to show all of a picture whose highest code is this, stops.

        Less bright displays show less of every gain: range that a picture does not use would dim its highlights there.
        """
        return max(brightest / _TOP * self.highest, _LEAST)

    def codes(self, rgb: FloatArray, picture: ByteArray) -> ByteArray:
        """The gains of a rendering in scene units, (H, W, C), of which `picture` has the codes (H, W, 3): uint8 (H, W)."""
        linear = replace(self.shown, space=replace(self.shown.space, linear=True))
        white = np.array(self.shown.white, np.float32)
        result = np.zeros(rgb.shape[:2], np.uint8)
        for rows in strips(len(rgb)):
            part = rgb[rows]
            # Channel by channel: NumPy takes three times as long for `any` along so short an axis.
            beyond = [part[..., channel] > limit for channel, limit in enumerate(white)]
            clipped = np.logical_or.reduce(beyond + [picture[rows, :, channel] == _TOP for channel in range(3)])
            if not clipped.any():
                continue
            light, most = part[clipped][None], white * np.float32(self.headroom)
            seen = self._luminance(self._shown_light(light)[0].clip(0, 1))
            whole = self._luminance(linear.apply(light.clip(-white, most), self.exposure)[0].clip(0, None))
            gains = np.log2((whole + np.float32(OFFSET)) / (seen + np.float32(OFFSET)))
            result[rows][clipped] = np.rint(gains * np.float32(_TOP / self.highest)).clip(0, _TOP)
        return result

    def _shown_light(self, rgb: FloatArray) -> FloatArray:
        """The light of the picture, before its curve, (H, W, 3)."""
        light = np.empty((*rgb.shape[:2], 3), np.float32)
        for rows, channel, plane in self.shown.light(rgb, self.exposure):
            light[rows, :, channel] = plane
        return light

    def _luminance(self, light: FloatArray) -> FloatArray:
        red, green, blue = self.shown.space.to_xyz[1].astype(np.float32)
        # No product of matrices: its last bits depend on the shape.
        return np.asarray(light[:, 0] * red + light[:, 1] * green + light[:, 2] * blue)
