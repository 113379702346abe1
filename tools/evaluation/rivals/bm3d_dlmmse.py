"""BM3D of each of the four planes of a Bayer mosaic, as users denoise in low light, then DLMMSE of
balanced samples.

The licence of the package `bm3d` allows non-commercial use only. It is imported only when the
method is run.
"""

import numpy as np

from ....shared.arrays import DoubleArray, FloatArray
from ...simulation.protocols import BayerShot
from ..cameras import Method, render_samples
from .dlmmse import demosaic_dlmmse

_BLOCK_SIDE = 8  # pixels of a plane each way: BM3D's block


def denoise_bayer(shot: BayerShot) -> FloatArray:
    """Apply BM3D to the four planes of a Bayer shot; float32 (H, W), scene units.

    BM3D gets the true noise, as our renderer does. With shot noise, the generalised Anscombe
    transform first makes the noise equal everywhere, and its unbiased inverse follows (Makitalo and
    Foi 2013). Planes smaller than 8 x 8 and shots without noise are returned unchanged.
    """
    denoised, photons, read = shot.samples.copy(), shot.shot, shot.read
    if min(denoised.shape) < 2 * _BLOCK_SIDE or (photons == 0 and read == 0):
        return denoised
    for row, column in np.ndindex(2, 2):
        plane = denoised[row::2, column::2].astype(np.float64)
        smooth = _stabilised_bm3d(plane, photons, read) if photons else _bm3d(plane, read)
        denoised[row::2, column::2] = smooth
    return denoised


def _bm3d(plane: DoubleArray, sigma: float) -> DoubleArray:
    import bm3d

    return np.asarray(bm3d.bm3d(plane, sigma), np.float64)


def _stabilised_bm3d(plane: DoubleArray, shot: float, read: float) -> DoubleArray:
    """BM3D between the generalised Anscombe transform and its unbiased inverse (closed form)."""
    electrons, electron_read = plane / shot, read / shot
    stable = 2 * np.sqrt(np.maximum(electrons + 3 / 8 + electron_read**2, 0))
    low, high = float(stable.min()), float(stable.max())
    span = max(high - low, 1e-9)
    smooth = np.maximum(_bm3d((stable - low) / span, 1 / span) * span + low, 2 * np.sqrt(3 / 8))
    root = np.sqrt(1.5)
    inverse = smooth**2 / 4 + root / (4 * smooth) - 11 / (8 * smooth**2)
    inverse += 5 * root / (8 * smooth**3) - 1 / 8 - electron_read**2
    return inverse * shot


def _render(shot: BayerShot, white: FloatArray) -> FloatArray:
    denoised = shot._replace(samples=denoise_bayer(shot))
    return render_samples(demosaic_dlmmse, denoised, white)


_TITLE = "Bayer, BM3D + DLMMSE, balanced"
METHODS = (Method("bm3d+dlmmse-wb", _TITLE, _render, balanced=True, packages=("bm3d",)),)
