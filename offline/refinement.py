"""Non-local averaging of chromaticity among pixels whose luminance looks alike (section 3.3, Eqs. 15-16)."""

import numpy as np

from shared.arrays import FloatArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from .kernels.averaging import average
from .kernels.compile import threads
from .settings import RefinementSettings

_PIECE = 1024  # rows worked on between two reports of progress
_TRUNCATE = 4  # standard deviations at which the Gaussian ends


def refine(
    initial: FloatArray, luminance: FloatArray, mosaic: Mosaic, settings: RefinementSettings, progress: Progress = SILENT
) -> FloatArray:
    """c+[n], float32 (H, W, C): Eq. 15 over a window of about one period, applied `settings.repetitions` times.

    sigma_z is that of the calibration's noise model at the frame's mean luminance, 0 if it has none.
    """
    height = luminance.shape[0]
    sigma = noise_level(luminance, mosaic)
    progress.stage("refinement", -(-height // _PIECE))
    result = np.empty_like(initial)
    for top in range(0, height, _PIECE):
        rows = top, min(top + _PIECE, height)
        _refine_into(result[slice(*rows)], initial, 0, luminance, mosaic.pattern.period, sigma, settings, rows)
        progress.advance()
    return result


def noise_level(luminance: FloatArray, mosaic: Mosaic) -> float:
    """sigma_z of Eq. 16: of the panchromatic plane, at the mean luminance."""
    noise = mosaic.calibration.noise
    return noise.sigma(float(luminance.mean(dtype=np.float64))) if noise else 0.0


def refine_rows(
    initial: FloatArray,
    first: int,
    luminance: FloatArray,
    period: int,
    sigma: float,
    settings: RefinementSettings,
    rows: tuple[int, int],
) -> FloatArray:
    """`refine` for rows[0] up to rows[1] of the frame, float32 (rows, W, C).

    initial: the frame's chromaticities from row `first` on, at least `reach` more than those rows on either side, or to the frame's
    edge; luminance: of the whole frame.
    """
    result = np.empty((rows[1] - rows[0], *initial.shape[1:]), np.float32)
    _refine_into(result, initial, first, luminance, period, sigma, settings, rows)
    return result


def _refine_into(
    result: FloatArray,
    initial: FloatArray,
    first: int,
    luminance: FloatArray,
    period: int,
    sigma: float,
    settings: RefinementSettings,
    rows: tuple[int, int],
) -> None:
    if settings.repetitions == 0:
        result[:] = initial[rows[0] - first : rows[1] - first]
        return
    width = max(settings.strength * sigma, settings.floor)  # h
    blur = gaussian(settings.blur * period)
    radius = period // 2  # a window of (K + 1) x (K + 1) for even K
    average(initial, first, luminance, rows, radius, blur, -0.5 / width**2, settings.repetitions, threads(), result)


def reach(period: int, settings: RefinementSettings) -> int:
    """Rows above and below one whose initial chromaticities its refined ones depend on."""
    return settings.repetitions * (period // 2)


def gaussian(sigma: float) -> FloatArray:
    """Its taps, which sum to one; float32, an odd number of them."""
    radius = int(_TRUNCATE * sigma + 0.5)
    taps = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    normalised: FloatArray = (taps / taps.sum()).astype(np.float32)
    return normalised
