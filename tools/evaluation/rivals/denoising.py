"""Denoising of a Bayer mosaic before demosaicing, as users do in low light: BM3D on each of its four planes.

The licence of the package `bm3d` allows non-commercial use only. It is imported only when a method that needs it is run.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from tools.camera.bayer import check_mosaic

from .colour_demosaicing import MENON
from .dlmmse import DLMMSE

LEAST = 8  # pixels of a plane each way: BM3D's block


def denoise_bayer(mosaic: FloatArray, shot: float, read: float) -> FloatArray:
    """Apply BM3D to the four planes of a Bayer mosaic; float32 (H, W), scene units.

    BM3D gets the true noise, as our renderer does. With shot noise, the generalised Anscombe transform first makes the noise equal
    everywhere, and its unbiased inverse follows (Makitalo and Foi 2013). Planes smaller than 8 x 8 and mosaics without noise are
    returned unchanged.

    mosaic: (H, W), scene units.
    shot, read: the noise, variance = shot * signal + read**2, scene units.
    """
    check_mosaic(mosaic)
    denoised = mosaic.copy()
    if min(mosaic.shape) < 2 * LEAST or (shot == 0 and read == 0):
        return denoised
    for row, column in product((0, 1), repeat=2):
        denoised[row::2, column::2] = denoise_plane(mosaic[row::2, column::2], shot, read)
    return denoised


def denoise_plane(plane: FloatArray, shot: float, read: float) -> DoubleArray:
    """BM3D of samples of one colour on a regular grid (h, w), as in `denoise_bayer`; one of shot and read is more than 0."""
    values = plane.astype(np.float64)
    return _stabilised_bm3d(values, shot, read) if shot else _bm3d(values, read)


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
    inverse = smooth**2 / 4 + root / (4 * smooth) - 11 / (8 * smooth**2) + 5 * root / (8 * smooth**3) - 1 / 8 - electron_read**2
    result: DoubleArray = inverse * shot
    return result


SECONDS = 40
"""Rough duration per megapixel, once for all methods that begin with it."""
METHODS = tuple(
    replace(
        each,
        name=f"bm3d+{each.name}",
        title=each.title.replace("Bayer, ", "Bayer, BM3D + "),
        denoise=denoise_bayer,
        packages=(*each.packages, "bm3d"),
        extra="rivals",
        seconds=each.seconds + SECONDS,
    )
    for each in (MENON, MENON.with_balance(), DLMMSE, DLMMSE.with_balance())
)
