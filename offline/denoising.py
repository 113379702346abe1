"""Denoise luminance by the amount of the sensor's noise: sliding-window DCTs, mixed with non-local means.

Shrinkage of overlapping DCT blocks goes back to Yaroslavsky's sliding window (1996). Weighting blocks by how few coefficients they
need, and a second pass with Wiener gains from the first result, are standard since. Small blocks suit edges, large ones gradients:
estimates of several sizes are averaged with those weights. This loses texture that hardly rises above the noise. There, the mean of
samples with similar surroundings keeps more (Buades, Coll and Morel 2005), and the surroundings compared here are already clean.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from .gaussian import gaussian
from .kernels.averaging import average
from .kernels.compile import threads
from .kernels.denoising import denoise
from .settings import DenoisingSettings

_PIECE, _LEAST_ROWS = 1 << 21, 128  # pixels between two reports of progress, and the least number of rows
_AROUND = 1.0  # pixels: standard deviation of the Gaussian that weights surroundings
# Standard deviations added to the guide: the average weights by light (Eq. 16), which is almost the same everywhere that far up.
_BRIGHT = 1000


def denoise_luminance(
    luminance: FloatArray, mosaic: Mosaic, noise: NoiseModel | None, settings: DenoisingSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] without noise, float32 (H, W), scene units; `luminance` itself where there is no noise to remove.

    luminance: (H, W), what `recover_luminance` returns. Its filled samples count as uncertain: the second pass replaces them by the
        result of the first.
    noise: noise of the mosaic; None = unknown, treated as none.
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
    step = max(_PIECE // width // _LEAST_ROWS, 1) * _LEAST_ROWS
    pieces = [(top, min(top + step, height)) for top in range(0, height, step)]
    progress.stage("denoising", 2 * len(pieces))
    for rows in pieces:
        model = np.float32(shot), np.float32(read), np.float32(settings.threshold)
        denoise(luminance, uncertain, rows, sizes, transforms, *model, threads(), result)
        progress.advance()
    # In place, piece by piece; `above` keeps the rows above a piece as they were before they were changed.
    reach = settings.radius + len(gaussian(_AROUND)) // 2
    above = result[:0]
    for top, bottom in pieces:
        guide = np.concatenate([above, result[top : bottom + reach]])
        around = slice(top - len(above), top - len(above) + len(guide))
        samples = np.where(uncertain[around], guide, luminance[around])
        above = guide[: len(above) + bottom - top][-reach:].copy()
        inside = top - around.start, bottom - around.start
        similar = similar_mean(samples, guide, inside, shot, read, settings)
        result[top:bottom] += np.float32(settings.share) * (similar - result[top:bottom])
        progress.advance()
    return result


def similar_mean(
    samples: FloatArray, guide: FloatArray, rows: tuple[int, int], shot: float, read: float, settings: DenoisingSettings
) -> FloatArray:
    """Non-local means of some rows of `samples`, float32 (rows[1] - rows[0], W).

    samples: (H, W), scene units; what is averaged.
    guide: (H, W), scene units; its surroundings are compared.
    rows: first and end row of the result.
    shot, read: variance of the noise = shot * signal + read**2.

    The weight of a pixel is exp(-d / (2 similarity^2)), d the mean of squared differences in standard deviations of the noise. A
    transform of the guide gives Poisson-Gaussian noise the same standard deviation at any brightness.
    """
    if shot > 0:
        even = (2 / shot) * np.sqrt(np.maximum(shot * guide.astype(np.float64) + read**2, 0))
    else:
        even = guide.astype(np.float64) / read
    even += _BRIGHT - even.min()
    mean = np.empty((rows[1] - rows[0], guide.shape[1], 1), np.float32)
    falloff = -0.5 / settings.similarity**2
    clean = even.astype(np.float32)
    average(samples[..., None], 0, clean, rows, settings.radius, gaussian(_AROUND), falloff, 1, threads(), mean)
    return mean[..., 0]


def cosines(size: int) -> FloatArray:
    """The matrix of the orthonormal DCT-II of `size` samples, float32 (size, size): [frequency, sample]."""
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)
