"""Denoise luminance by the amount of the sensor's noise: shrinkage in overlapping DCT blocks.

Shrinkage of overlapping DCT blocks goes back to Yaroslavsky's sliding window (1996). Weighting blocks by how few coefficients they
need, and a second pass with Wiener gains from the first result, are standard since. Small blocks suit edges, large ones gradients:
estimates of several sizes are averaged with those weights.

Neighbouring blocks give nearly the same estimate: a quarter of them, on a quincunx, loses 0.01 to 0.02 dB. Weights that prefer
blocks of few coefficients more than their variance asks for gain 0.05 dB.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..kernels.denoising import denoise
from ..settings import DenoisingSettings

_PIECE, _LEAST_ROWS = 1 << 21, 256  # pixels between two reports of progress, and the least number of rows


def denoise_luminance(
    luminance: FloatArray, mosaic: Mosaic, settings: DenoisingSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] without noise, float32 (H, W), scene units; `luminance` itself where there is no noise to remove.

    luminance: (H, W), what `recover_luminance` returns. Its filled samples count as uncertain: the second pass replaces them by the
        result of the first.
    mosaic: its noise model and its pattern are used.
    """
    (height, width), noise = luminance.shape, mosaic.calibration.noise
    shot, read = (settings.strength**2 * noise.shot[-1], settings.strength * noise.read[-1]) if noise else (0.0, 0.0)
    if shot == 0 and read == 0:
        return luminance
    sizes: IndexArray = np.array(settings.sizes, np.intp)
    transforms = np.zeros((len(sizes), sizes.max(), sizes.max()), np.float32)
    for transform, size in zip(transforms, settings.sizes, strict=True):
        transform[:size, :size] = cosines(size)
    uncertain = ~mosaic.pattern.panchromatic_mask((mosaic.pattern.period, width))
    result = np.empty_like(luminance)
    step = max(_PIECE // width // _LEAST_ROWS, 1) * _LEAST_ROWS
    pieces = [(top, min(top + step, height)) for top in range(0, height, step)]
    progress.stage("denoising", len(pieces))
    model = np.float32(shot), np.float32(read), np.float32(settings.threshold)
    for rows in pieces:
        denoise(luminance, uncertain, rows, sizes, transforms, *model, result)
        progress.advance()
    return result


def cosines(size: int) -> FloatArray:
    """The matrix of the orthonormal DCT-II of `size` samples, float32 (size, size): [frequency, sample]."""
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)
