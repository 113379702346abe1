"""One chromaticity per colour block by constrained least squares, and oriented medians against outliers (section 3.2, Eqs. 6-9)."""

import numpy as np

from shared.arrays import BORDER, DoubleArray, FloatArray
from shared.progress import SILENT, Progress

from ..blocks import BlockSums
from ..cleaned import Cleaned
from ..kernels.medians import SLACK, oriented_median
from ..kernels.pieces import BLOCK_ROWS, in_strips
from ..settings import ChromaticitySettings

# Least sigma_z of the regularisation, scene units: makes a block without light grey, and changes no other.
_LEAST_SIGMA = 1e-6
_LEAST_TOTAL = 0.5  # sum_i gamma_i c_i, 1 before the medians, above which scaling is harmless: it changes a vector by twice at most


def estimate_chromaticities(
    frame: Cleaned,
    luminance: FloatArray,
    settings: ChromaticitySettings,
    progress: Progress = SILENT,
    others: BlockSums | None = None,
) -> FloatArray:
    """c_j of every block of the grid, float32 (block rows, block columns, C); sum_i gamma_i c_i = 1 in each.

    Blocks that lie partly or wholly outside the frame take the value of the nearest whole block.

    luminance: (H, W), scene units.
    others: what other frames add to the sums of each whole block.
    """
    progress.stage("chromaticity", settings.repetitions)
    gamma, sums, sigma = frame.gamma, block_sums(frame, luminance), sigma_z(frame)
    chromaticity = sums.solved(sigma, gamma)
    if others is not None:
        chromaticity = (BlockSums(sums.weight, sums.weight * chromaticity) + others).solved(sigma, gamma)
    if settings.taps > 1:
        chromaticity = oriented_medians(chromaticity, settings.taps, settings.repetitions, progress)
    # Medians of single channels leave the constraint's plane (errata). Scaling brings the vectors back. Far off the plane, where
    # estimates are wild (darkness), scaling would blow them up: there the nearest point of the plane is the safe way back.
    scaled = np.empty_like(chromaticity)

    def constrain(rows: slice) -> None:
        total = (chromaticity[rows] @ gamma)[..., None]
        scaled[rows] = chromaticity[rows] / np.where(total > _LEAST_TOTAL, total, 1)
        if total.min() <= _LEAST_TOTAL:
            projected = chromaticity[rows] + (1 - total) * gamma / (gamma @ gamma)
            scaled[rows] = np.where(total > _LEAST_TOTAL, scaled[rows], projected)

    in_strips(constrain, len(scaled), BLOCK_ROWS)
    return frame.sites.grid.extend(scaled.astype(np.float32))


def block_sums(frame: Cleaned, luminance: FloatArray) -> BlockSums:
    """The sums of Eqs. 8-9 of each whole block. luminance: (H, W), scene units."""
    shape = *frame.sites.shape, len(frame.gamma)
    weight, product, signal = np.zeros(shape), np.zeros(shape), frame.signal

    def work(rows: slice) -> None:
        for channel, place in zip(frame.sites.channels, frame.sites.at(rows), strict=True):
            light = luminance[place].astype(np.float64)
            weight[rows, :, channel] += light**2
            product[rows, :, channel] += light * signal[place]

    in_strips(work, len(weight), BLOCK_ROWS)
    return BlockSums(weight, product)


def sigma_z(frame: Cleaned) -> float:
    """sigma_z of Eqs. 8-9, scene units: the noise of all channels at the mean sample of the whole blocks.

    An estimate counts as no noise here: texture raises it, and single scenes then lose 0.2 dB, while the mean gains 0.01 dB.
    """
    places, noise = frame.sites.places, None if frame.estimated else frame.noise
    level = 0.0
    for place in places:
        level += float(frame.signal[place].mean()) / len(places)
    variances = [noise.sigma(level, plane) ** 2 for plane in range(len(frame.gamma))] if noise else [0.0]
    return max(float(np.mean(variances)) ** 0.5, _LEAST_SIGMA)


def oriented_medians(chromaticity: DoubleArray, taps: int, repetitions: int, progress: Progress = SILENT) -> DoubleArray:
    """Replace each vector by the nearest of its 1-D medians along four orientations, and repeat until nothing changes.

    chromaticity: (rows, columns, C), the coarse image, mirrored at its border. Channels are filtered one by one.
    taps: length of the medians, odd, 3 or more.
    repetitions: largest number of repetitions.
    """
    (rows, columns), half = chromaticity.shape[:2], taps // 2
    iterations = 0
    wide = np.pad(chromaticity.transpose(2, 0, 1), ((0, 0), (0, 0), (half, half + SLACK)), mode=BORDER)
    before, changed = np.ascontiguousarray(wide), np.ones(rows, np.bool_)
    after = np.empty_like(before)
    while iterations < repetitions and changed.any():
        found = np.zeros_like(changed)
        oriented_median(before, after, columns, taps, changed, found)
        before, after, changed = after, before, found
        iterations += 1
        progress.advance()
    progress.solved("medians", iterations, float(changed.mean()))
    return np.ascontiguousarray(before[:, :, half : half + columns].transpose(1, 2, 0))
