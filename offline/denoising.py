"""Denoising luminance by shrinking the coefficients of sliding-window DCTs, as far as the sensor's noise goes.

Shrinkage of overlapping DCT blocks is as old as Yaroslavsky's sliding window (1996); weights by how few coefficients a block needs,
and a second pass with Wiener gains from the first one's result, are usual since. Small blocks suit edges, large ones gradients and
texture: the estimates of two sizes are averaged with those same weights.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic

from .kernels.compile import threads
from .kernels.denoising import denoise
from .progress import SILENT, Progress
from .settings import DenoisingSettings

_PIECE = 512  # rows worked on between two reports of progress


def denoise_luminance(
    luminance: FloatArray, mosaic: Mosaic, noise: NoiseModel | None, settings: DenoisingSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] without noise, float32 (H, W), scene units; `luminance` itself where there is none to take away.

    luminance: of `recover_luminance`, whose filled samples count as uncertain: the second pass sees the first one's in their place.
    noise: of the mosaic; None: unknown, and taken for none.
    """
    height, width = luminance.shape
    shot, read = (settings.strength**2 * noise.shot[-1], settings.strength * noise.read[-1]) if noise else (0.0, 0.0)
    if shot == 0 and read == 0:
        return luminance
    sizes: IndexArray = np.array(settings.sizes, np.intp)
    transforms = np.zeros((len(sizes), sizes.max(), sizes.max()), np.float32)
    for transform, size in zip(transforms, settings.sizes, strict=True):
        transform[:size, :size] = cosines(size)
    uncertain = ~mosaic.pattern.panchromatic_mask((height, width))
    result = np.empty_like(luminance)
    progress.stage("denoising", -(-height // _PIECE))
    for top in range(0, height, _PIECE):
        rows = top, min(top + _PIECE, height)
        model = np.float32(shot), np.float32(read), np.float32(settings.threshold)
        denoise(luminance, uncertain, rows, sizes, transforms, *model, threads(), result)
        progress.advance()
    return result


def cosines(size: int) -> FloatArray:
    """The orthonormal DCT-II of `size` samples, float32 (size, size): [frequency, sample]."""
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)
