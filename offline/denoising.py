"""Denoising luminance as far as the sensor's noise goes: sliding-window DCTs, and a share of non-local means.

Shrinkage of overlapping DCT blocks is as old as Yaroslavsky's sliding window (1996); weights by how few coefficients a block needs,
and a second pass with Wiener gains from the first one's result, are usual since. Small blocks suit edges, large ones gradients: the
estimates of several sizes are averaged with those same weights. What it loses is texture that hardly rises above the noise. There
the samples of similar surroundings still tell (Buades, Coll and Morel 2005), all the better as the surroundings compared are clean.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from .kernels.averaging import average
from .kernels.compile import threads
from .kernels.denoising import denoise
from .refinement import gaussian
from .settings import DenoisingSettings

_PIECE, _LEAST_ROWS = 1 << 21, 128  # pixels worked on between two reports of progress, and rows
_AROUND = 1.0  # pixels: standard deviation of the Gaussian that weighs surroundings
# Standard deviations added to the guide: the average weighs by light (Eq. 16), which so far up is the same for all.
_BRIGHT = 1000


def denoise_luminance(
    luminance: FloatArray, mosaic: Mosaic, noise: NoiseModel | None, settings: DenoisingSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] without noise, float32 (H, W), scene units; `luminance` itself where there is none to take away.

    luminance: of `recover_luminance`, whose filled samples count as uncertain: what follows sees the first pass in their place.
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
    step = max(_PIECE // width // _LEAST_ROWS, 1) * _LEAST_ROWS
    pieces = [(top, min(top + step, height)) for top in range(0, height, step)]
    progress.stage("denoising", 2 * len(pieces))
    for rows in pieces:
        model = np.float32(shot), np.float32(read), np.float32(settings.threshold)
        denoise(luminance, uncertain, rows, sizes, transforms, *model, threads(), result)
        progress.advance()
    # In place, piece by piece: above a piece, what lay there before the last one.
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
    """Non-local means of `samples`, (rows[1] - rows[0], W), with the surroundings of `guide` compared; both (H, W), scene units.

    The weight of a pixel is exp(-d / (2 similarity^2)), d the mean of squared differences in standard deviations of the noise. So
    they are, at any brightness, after the transform that makes Poisson-Gaussian noise even.
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
    """The orthonormal DCT-II of `size` samples, float32 (size, size): [frequency, sample]."""
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)
