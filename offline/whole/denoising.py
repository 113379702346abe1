"""Denoise luminance by the amount of the sensor's noise: overlapping DCT blocks, mixed with non-local means.

Shrinkage of overlapping DCT blocks goes back to Yaroslavsky's sliding window (1996). Weighting blocks by how few coefficients they
need, and a second pass with Wiener gains from the first result, are standard since. Small blocks suit edges, large ones gradients:
estimates of several sizes are averaged with those weights. This loses texture that hardly rises above the noise. There, the mean of
samples with similar surroundings keeps more (Buades, Coll and Morel 2005), and the surroundings compared here are already clean.
It takes part where the noise is at least a fiftieth of the light.

Neighbouring blocks give nearly the same estimate: a quarter of them, on a quincunx, loses 0.01 to 0.02 dB. Weights that prefer
blocks of few coefficients more than their variance asks for, and surroundings of 3 x 3 pixels, gain 0.05 dB.
"""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..kernels.denoising import denoise
from ..kernels.similar import AREA, SURROUNDINGS, average_similar
from ..settings import DenoisingSettings

_PIECE, _LEAST_ROWS = 1 << 21, 256  # pixels between two reports of progress, and the least number of rows
# Noise, a share of the light, below which similar pixels are not averaged, and from which on their mean has its whole share.
# Measured on 20 photographs: below 0.03 it gains nothing, above 0.05 it gains 0.05 to 0.15 dB of luminance.
_QUIET, _NOISY = 0.02, 0.04


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
    progress.stage("denoising", 2 * len(pieces))
    model = np.float32(shot), np.float32(read), np.float32(settings.threshold)
    for rows in pieces:
        denoise(luminance, uncertain, rows, sizes, transforms, *model, result)
        progress.advance()
    # In place, piece by piece; `above` keeps the rows above a piece as they were before they were changed.
    reach, shares = settings.radius + SURROUNDINGS, _shares(luminance, shot, read, settings.share)
    above = result[:0]
    for top, bottom in pieces:
        guide = np.concatenate([above, result[top : bottom + reach]])
        around = slice(top - len(above), top - len(above) + len(guide))
        above = guide[: len(above) + bottom - top][-reach:].copy()
        alike = *model[:2], np.float32(settings.similarity), shares
        average_similar(luminance, uncertain, guide, around.start, (top, bottom), settings.radius, *alike, result[top:bottom])
        progress.advance()
    return result


def _shares(luminance: FloatArray, shot: float, read: float, most: float) -> FloatArray:
    """The share of the mean of similar pixels in each `AREA` of the frame, as `average_similar` takes it, by the noise there."""
    rows, columns = (np.arange(0, size, step) for size, step in zip(luminance.shape, AREA, strict=True))
    total = np.stack([np.add.reduceat(luminance[row : row + AREA[0]].sum(axis=0, dtype=np.float64), columns) for row in rows])
    count = np.outer(*(np.diff(starts, append=size) for starts, size in zip((rows, columns), luminance.shape, strict=True)))
    mean = total / count
    noise = np.sqrt(np.maximum(shot * mean + read**2, 0)) / np.maximum(mean, np.finfo(np.float32).tiny)
    return (most * np.interp(noise, (_QUIET, _NOISY), (0, 1))).astype(np.float32)


def cosines(size: int) -> FloatArray:
    """The matrix of the orthonormal DCT-II of `size` samples, float32 (size, size): [frequency, sample]."""
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)
