"""Denoising by BM3D, as users do in low light: each of the four planes before demosaicing, or the picture after it.

The licence of the package `bm3d` allows non-commercial use only. It is imported only when a method that needs it is run.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from tools.simulation.noise import BayerShot

from ..cameras import with_balance
from ..method import Method
from .dlmmse import DLMMSE, demosaic_dlmmse
from .interpolation import MENON

_PACKAGES = ("bm3d",)
LEAST = 8  # pixels of a plane each way: BM3D's block
_SPREAD = 1.5  # the best of 1, 1.25, 1.5 and 2 after DLMMSE: Jin, Facciolo and Morel, "A review of an old dilemma", 2020


def denoise_bayer(mosaic: FloatArray, shot: float, read: float) -> FloatArray:
    """Apply BM3D to the four planes of a Bayer mosaic; float32 (H, W), scene units.

    BM3D gets the true noise, as our renderer does. With shot noise, the generalised Anscombe transform first makes the noise equal
    everywhere, and its unbiased inverse follows (Makitalo and Foi 2013). Planes smaller than 8 x 8 and mosaics without noise are
    returned unchanged.

    mosaic: (H, W), scene units.
    shot, read: the noise, variance = shot * signal + read**2, scene units.
    """
    denoised = mosaic.copy()
    if min(mosaic.shape) < 2 * LEAST or (shot == 0 and read == 0):
        return denoised
    for row, column in product((0, 1), repeat=2):
        denoised[row::2, column::2] = denoise_plane(mosaic[row::2, column::2], shot, read)
    return denoised


def denoise_plane(plane: FloatArray, shot: float, read: float) -> DoubleArray:
    """BM3D of samples of one colour on a regular grid (h, w), or CBM3D of a picture (h, w, 3), as in `denoise_bayer`.

    One of shot and read is more than 0.
    """
    values = plane.astype(np.float64)
    return _stabilised_bm3d(values, shot, read) if shot else _bm3d(values, read)


def demosaic_first(shot: BayerShot, white: FloatArray) -> FloatArray:
    """DLMMSE of balanced samples, then CBM3D of the picture, float32 (H, W, 3), scene units; without noise DLMMSE alone.

    Demosaicking spreads noise over neighbouring pixels: CBM3D is told `_SPREAD` times its standard deviation.
    """
    picture = with_balance(demosaic_dlmmse, shot.samples, white)
    if min(picture.shape[:2]) < LEAST or (shot.shot == 0 and shot.read == 0):
        return picture
    return denoise_plane(picture, _SPREAD**2 * shot.shot, _SPREAD * shot.read).astype(np.float32)


def _bm3d(plane: DoubleArray, sigma: float) -> DoubleArray:
    import bm3d

    return np.asarray((bm3d.bm3d_rgb if plane.ndim == 3 else bm3d.bm3d)(plane, sigma), np.float64)


def _stabilised_bm3d(plane: DoubleArray, shot: float, read: float) -> DoubleArray:
    """BM3D between the generalised Anscombe transform and its unbiased inverse (closed form)."""
    electrons, electron_read = plane / shot, read / shot
    stable = 2 * np.sqrt(np.maximum(electrons + 3 / 8 + electron_read**2, 0))
    low, high = float(stable.min()), float(stable.max())
    span = max(high - low, 1e-9)
    smooth = np.maximum(_bm3d((stable - low) / span, 1 / span) * span + low, 2 * np.sqrt(3 / 8))
    root = np.sqrt(1.5)
    inverse = smooth**2 / 4 + root / (4 * smooth) - 11 / (8 * smooth**2) + 5 * root / (8 * smooth**3) - 1 / 8 - electron_read**2
    return inverse * shot


SECONDS = 40
"""Rough duration per megapixel, once for all methods that begin with it."""


def _denoised(method: Method) -> Method:
    name, title = f"bm3d+{method.name}", method.title.replace("Bayer, ", "Bayer, BM3D + ")
    packages, seconds = (*method.packages, *_PACKAGES), method.seconds + SECONDS
    return replace(method, name=name, title=title, denoise=denoise_bayer, packages=packages, seconds=seconds)


_CBM3D = "Bayer, DLMMSE + CBM3D, balanced"
METHODS = (
    *map(_denoised, (MENON, MENON.with_balance(), DLMMSE, DLMMSE.with_balance())),
    Method("dlmmse+cbm3d", _CBM3D, demosaic_first, balanced=True, whole_shot=True, packages=_PACKAGES, seconds=60),
)
