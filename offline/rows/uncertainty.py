"""How far a picture may be off, pixel by pixel: standard deviations of luminance and of colour, from what the render knows.

The variance of an error is a sum of what foretells it, with weights that were learned from photographs (`WEIGHTS`), not negative.
All of it is seen in a render:

- the noise of a panchromatic sample, and what a picture keeps or loses of texture and grain when that is taken off;
- the grain of the scene itself: what smooth parts of the shot vary by more than its noise. One block in K x K pixels cannot see it;
- how chromaticity varies around a pixel, and how far it is from that between the blocks around: errors are large at borders of
  colours, and where few pixels decide to which block they belong;
- contrast: fine detail may have colours that no block met; and at colour sites luminance is filled in;
- how far the samples have corrected luminance at these.

None of this is in the paper.
"""

from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.mosaic import Mosaic

from ..kernels.uncertainty import WIDE, uncertainty
from ..measured import Measured, Stages, make_stages
from ..parts import Look, Part, RowStage
from ..settings import RenderSettings
from ..whole.noise import estimate_noise

# By `python -m tools.evaluation.uncertainty`, from every second one of the 14 test photographs. Of luminance: noise; noise times
# the share of contrast in the sum of both (standard deviations); noise and grain in parallel (a b / (a + b)); and at colour sites
# contrast, grain, contrast times correction (standard deviations). Of colour: noise; grain; variance of chromaticity in 7 x 7
# pixels times squared luminance; squared distance from the colour between the blocks; contrast; root of the first times the third.
# Contrast is the variance of luminance in 3 x 3 pixels.
WEIGHTS = ((0.025, 0.47, 0.9, 0.0039, 0.9, 0.54), (0.0084, 0.22, 0.14, 0.32, 0.0016, 0.17))
# An estimate of noise from the shot is this much higher than the noise by chance, or by texture: measured at sigma 0.03.
_CHANCE = 1.1
# Frames of a burst lie fractions of a pixel apart, so that luminance gains less from them than their noise does; and they show
# colour where one has no sites, and luminance where it has some. Exponents of the share of the noise that is left, chosen on bursts
# of eight: of the errors of luminance at sigma 0.01 70 % instead of 60 % lie within; without noise 82 % instead of 87 % of those
# of colour, and 80 % instead of 89 % of those of luminance.
_MERGED, _SHOWN = 2 / 3, 1 / 3


@dataclass(eq=False)
class Uncertainty(RowStage):
    """State how far the picture may be off (`Part.uncertainty`): the last stage of all.

    measured: of the frame.
    grain: the noise that smooth parts of the shot show, in the frame's units; None = as much as is known.
    shares: variance that is left of the noise, relative to a single frame's, (H, W); None = it is one.
    weights: (2, 6), of what foretells errors, see `WEIGHTS`.
    """

    measured: Measured
    grain: NoiseModel | None
    shares: FloatArray | None = None
    weights: tuple[tuple[float, ...], ...] = WEIGHTS

    name = "uncertainty"
    kernels = ("uncertainty",)

    @classmethod
    def of(cls, mosaic: Mosaic, measured: Measured, settings: RenderSettings, shares: FloatArray | None = None) -> "Uncertainty":
        """The stage for a shot. Raises InputError for settings of which nobody knows how far they are off."""
        if not settings.pooling.used:
            raise InputError("the uncertainty of a picture is known for the presets best and unlearned, and settings like these")
        known = mosaic.calibration.noise is not None  # otherwise the render's noise is such an estimate
        grain = estimate_noise(mosaic) if known else None
        if shares is None:
            return cls(measured, grain)
        left = np.ones((2, 6))
        left[0, 3:] = left[1, 2:5] = float(shares.mean()) ** _SHOWN
        return cls(measured, grain, shares ** np.float32(_MERGED), tuple(map(tuple, left * WEIGHTS)))

    @property
    def look(self) -> Look:
        """The pixels around a pixel."""
        return Look(WIDE)

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * (6 + 3 * channels) * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with their uncertainty."""
        measured, gamma, grid, held = self.measured, self.measured.gamma, self.measured.grid, slice(part.first, part.end)
        shading, noise = measured.calibration.shading, measured.calibration.noise
        gain = None if shading is None else shading.of_plane(measured.shape, -1, held)
        light = part.luminance if gain is None else part.luminance / gain
        known = np.zeros((3, *light.shape), np.float32)
        if noise is not None:
            known[0] = noise.variance(light)
        if self.grain is not None:
            np.maximum(self.grain.variance(light) - np.float32(_CHANCE) * known[0], 0, out=known[1])
        if self.shares is not None:
            known[0] *= self.shares[held]
        known[2] = -1
        for _, rest, across in measured.pattern.lattices:
            down = slice((rest.start - part.first) % grid.period, None, grid.period)
            known[2, down, across] = np.abs(light[down, across] - measured.luminance[held][down, across])
        middle = [(size - 1) / 2 for size in grid.block_shape]
        place = (np.arange(light.shape[1]) - grid.columns[0] - middle[1]) / grid.period
        left = place.clip(0, grid.shape[1] - 1).astype(np.intp)
        near = (place - left).clip(0, 1).astype(np.float32)
        weights = np.zeros((3, 6), np.float32)
        weights[:2], weights[2, 0] = self.weights, 1 / grid.period
        shown, first = part.rows(*rows), rows[0] - part.first
        found = np.empty((*shown.luminance.shape, 1 + len(gamma)), np.float32)
        shares, blocks = (
            np.multiply(np.moveaxis(each, 2, 0), gamma[:, None, None], order="C") for each in (part.chromaticity, measured.blocks)
        )
        above = (rows[0] - grid.rows[0] - middle[0]) / grid.period
        uncertainty(light, known, shares, blocks, (left, near), above, first, gamma, weights, found)
        inner = slice(first, first + len(found))
        if measured.lost is not None:  # where nothing is known of the light, it may be off by all of it
            found += (measured.lost[slice(*rows)] / np.float32(255) * light[inner])[..., None]
        if gain is not None:
            found *= gain[inner, :, None]
        return replace(shown, uncertainty=found)


def with_uncertainty(mosaic: Mosaic, stages: Stages, shares: FloatArray | None = None) -> Stages:
    """These stages, and after them the one that states how far the picture of a shot may be off.

    shares: of a burst, variance of the noise of luminance relative to a single frame's, (H, W).
    Raises InputError, when the stages are made, for settings that do not pool colour, such as those of the preset paper.

    >>> import numpy as np
    >>> from offline import render, row_stages, with_uncertainty
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> render(grey, stages=with_uncertainty(grey, row_stages)).uncertainty.shape
    (30, 40, 4)
    """
    return lambda measured, settings, progress: [
        *make_stages(stages, measured, settings, progress),
        Uncertainty.of(mosaic, measured, settings, shares),
    ]
