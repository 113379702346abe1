"""What a user in low light does before demosaicing: BM3D on each of the four planes of a Bayer mosaic.

The package `bm3d` may be used for non-commercial purposes only; it is asked for only where it is installed.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray

from .bayer import check_mosaic

_LEAST = 8  # pixels of a plane each way: BM3D's block


def denoise_bayer(mosaic: FloatArray, shot: float, read: float) -> FloatArray:
    """BM3D on the four planes of a Bayer mosaic (H, W), scene units; float32 of the same shape.

    shot, read: the noise, variance = shot * signal + read**2, scene units: BM3D knows it, as our renderer does. With shot noise the
    samples go through the generalised Anscombe transform, which makes their noise even, and back without bias
    (Makitalo and Foi 2013). Planes smaller than 8 x 8, and mosaics without noise, stay as they are.
    """
    check_mosaic(mosaic)
    denoised = mosaic.copy()
    if min(mosaic.shape) < 2 * _LEAST or (shot == 0 and read == 0):
        return denoised
    for row in (0, 1):
        for column in (0, 1):
            plane = mosaic[row::2, column::2].astype(np.float64)
            if shot:
                denoised[row::2, column::2] = _even_out(plane, shot, read)
            else:
                denoised[row::2, column::2] = _bm3d(plane, read)
    return denoised


def _bm3d(plane: DoubleArray, sigma: float) -> DoubleArray:
    import bm3d

    result: DoubleArray = np.asarray(bm3d.bm3d(plane, sigma), np.float64)
    return result


def _even_out(plane: DoubleArray, shot: float, read: float) -> DoubleArray:
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
