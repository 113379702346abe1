"""Non-local averaging of chromaticity among pixels whose luminance looks alike (section 3.3, Eqs. 15-16)."""

import numpy as np

from shared.arrays import FloatArray
from shared.calibration import NoiseModel
from shared.progress import SILENT, Progress

from ..gaussian import gaussian
from ..kernels.averaging import average
from ..kernels.compile import threads
from ..settings import RefinementSettings
from ..tiling import Band


def refine(
    initial: FloatArray,
    luminance: FloatArray,
    period: int,
    sigma: float,
    settings: RefinementSettings,
    band: Band,
    progress: Progress = SILENT,
) -> FloatArray:
    """c+[n] of the band's rows, float32 (rows, W, C): Eq. 15 over a window of about one period, applied `repetitions` times.

    initial: c[n] from row `band.first` of the frame on, at least `reach` rows beyond the band's rows or to the frame's edge.
    luminance: (H, W), the whole frame.
    period: K, pixels.
    sigma: sigma_z of Eq. 16, scene units (see `noise_level`).
    """
    progress.part("refinement")
    top, bottom = band.rows
    if settings.repetitions == 0:
        return initial[top - band.first : bottom - band.first].copy()
    result = np.empty((bottom - top, *initial.shape[1:]), np.float32)
    width = max(settings.strength * sigma, settings.floor)  # h
    blur = gaussian(settings.blur * period)
    radius = period // 2  # a window of (K + 1) x (K + 1) for even K
    average(initial, band.first, luminance, band.rows, radius, blur, -0.5 / width**2, settings.repetitions, threads(), result)
    return result


def noise_level(luminance: FloatArray, noise: NoiseModel | None) -> float:
    """sigma_z of Eq. 16, scene units: panchromatic noise at the mean luminance; 0 if there is no noise model."""
    return noise.sigma(float(luminance.mean(dtype=np.float64))) if noise else 0.0


def reach(period: int, settings: RefinementSettings) -> int:
    """How many rows above and below a pixel its refined chromaticity depends on. period: K, pixels."""
    return settings.repetitions * (period // 2)
