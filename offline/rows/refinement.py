"""Non-local averaging of chromaticity among pixels whose luminance looks alike (section 3.3, Eqs. 15-16)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from shared.arrays import FloatArray, mirrored
from shared.calibration import NoiseModel

from ..gaussian import gaussian
from ..kernels.averaging import average
from ..measured import Measured
from ..parts import Look, Part, RowStage
from ..settings import RefinementSettings


@dataclass(eq=False)
class Refinement(RowStage):
    """c+[n] of Eq. 15 over a window of about one period, applied `settings.repetitions` times, 1 or more."""

    measured: Measured
    settings: RefinementSettings

    name = "refinement"
    kernels = ("average",)

    @property
    def look(self) -> Look:
        """Half a window for each repetition."""
        return Look(self.settings.repetitions * (self.measured.pattern.period // 2))

    @cached_property
    def sigma(self) -> float:
        """sigma_z of Eq. 16, scene units."""
        return noise_level(self.measured.luminance, self.measured.calibration.noise)

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows with their chromaticity refined."""
        luminance, period = self.measured.luminance, self.measured.pattern.period
        return Part(rows[0], part.rows(*rows).luminance, refine(part, rows, luminance, period, self.sigma, self.settings))


def refine(
    part: Part, rows: tuple[int, int], luminance: FloatArray, period: int, sigma: float, settings: RefinementSettings
) -> FloatArray:
    """c+[n] of some rows of the frame, float32 (rows, W, C).

    part: c[n], with what the window reaches around these rows.
    luminance: (H, W), the whole frame.
    period: K, pixels.
    sigma: sigma_z of Eq. 16, scene units (see `noise_level`).
    """
    if not settings.used:
        return part.rows(*rows).chromaticity.copy()
    result = np.empty((rows[1] - rows[0], *part.chromaticity.shape[1:]), np.float32)
    width = max(settings.strength * sigma, settings.floor)  # h
    blur, radius = gaussian(settings.blur * period), period // 2  # a window of (K + 1) x (K + 1) for even K
    margin = (settings.repetitions + 1) * radius + len(blur) // 2
    down, across = (
        mirrored(np.arange(first - margin, end + margin), size)
        for (first, end), size in zip((rows, (0, luminance.shape[1])), luminance.shape, strict=True)
    )
    at = (down - part.first).clip(0, len(part.chromaticity) - 1)  # beyond them, weights alone are needed
    initial = np.ascontiguousarray(part.chromaticity)
    average(initial, luminance, (down, at, across), radius, blur, -0.5 / width**2, settings.repetitions, result)
    return result


def noise_level(luminance: FloatArray, noise: NoiseModel | None) -> float:
    """sigma_z of Eq. 16, scene units: panchromatic noise at the mean luminance; 0 if there is no noise model."""
    return noise.sigma(float(luminance.mean(dtype=np.float64))) if noise else 0.0
