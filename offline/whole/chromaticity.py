"""One chromaticity per colour block by constrained least squares, and oriented medians against outliers (section 3.2, Eqs. 6-9)."""

import numpy as np

from shared.arrays import BORDER, DoubleArray, FloatArray
from shared.mosaic import Mosaic
from shared.pattern import BlockGrid
from shared.progress import SILENT, Progress

from ..blocks import block_sites
from ..kernels.medians import SLACK, oriented_median
from ..settings import ChromaticitySettings
from ..sites import solve_jointly
from .detail import give_back

# Least sigma_z of the regularisation, scene units: makes a block without light grey, and changes no other.
_LEAST_SIGMA = 1e-6
_LEAST_TOTAL = 0.5  # sum_i gamma_i c_i above which scaling is harmless


def estimate_chromaticities(
    mosaic: Mosaic,
    luminance: FloatArray,
    settings: ChromaticitySettings,
    progress: Progress = SILENT,
    extra: DoubleArray | None = None,
) -> FloatArray:
    """c_j of every block of the grid, float32 (block rows, block columns, C); sum_i gamma_i c_i = 1 in each.

    Blocks that lie partly or wholly outside the frame take the value of the nearest whole block.

    luminance: (H, W), scene units.
    extra: what other frames add to sum l^2 and sum l m of each channel of each whole block, (2 C, rows, columns).
    """
    progress.stage("chromaticity", settings.repetitions)
    grid = mosaic.pattern.grid(mosaic.shape)
    gamma = np.array(mosaic.calibration.gamma)
    sums = block_sums(mosaic, luminance, grid)
    chromaticity = solve_constrained(*sums, gamma)
    if settings.mismatch:
        chromaticity = solve_jointly(mosaic, luminance, grid, chromaticity, sums[2], settings.mismatch)
    if extra is not None:
        more, products = (np.moveaxis(part, 0, 2) for part in np.split(extra, 2))
        weight = sums[0]
        chromaticity = solve_constrained(weight + more, weight * chromaticity + products, sums[2], gamma)
    unfiltered = chromaticity
    if settings.taps > 1:
        chromaticity = oriented_medians(chromaticity, settings.taps, settings.repetitions, progress)
    # Medians of single channels leave the constraint's plane (errata). Scaling brings the vectors back. Far off the plane, where
    # estimates are wild (darkness), scaling would blow them up: there the nearest point of the plane is the safe way back.
    total = (chromaticity @ gamma)[..., None]
    scaled = chromaticity / np.where(total > _LEAST_TOTAL, total, 1)
    if total.min() <= _LEAST_TOTAL:
        projected = chromaticity + (1 - total) * gamma / (gamma @ gamma)
        scaled = np.where(total > _LEAST_TOTAL, scaled, projected)
    if settings.trust:
        scaled = give_back(unfiltered, scaled, sums, gamma, settings.trust)
    return grid.extend(scaled.astype(np.float32))


def block_sums(mosaic: Mosaic, luminance: FloatArray, grid: BlockGrid) -> tuple[DoubleArray, DoubleArray, float]:
    """The sums of Eqs. 8-9 of each whole block: sum l^2 and sum l m per channel, both float64 (rows, columns, C), and sigma_z."""
    shape = len(grid.whole_rows), len(grid.whole_columns), len(mosaic.pattern.channels)
    weight, product, signal = np.zeros(shape), np.zeros(shape), mosaic.signal
    level = 0.0
    for channel, *site in block_sites(mosaic.pattern, grid):
        light, sample = luminance[*site].astype(np.float64), signal[*site]
        weight[..., channel] += light**2
        product[..., channel] += light * sample
        level += float(sample.mean()) / len(mosaic.pattern.sites)
    noise = mosaic.calibration.noise
    variances = [noise.sigma(level, plane) ** 2 for plane in range(shape[2])] if noise else [0.0]
    return weight, product, max(float(np.mean(variances)) ** 0.5, _LEAST_SIGMA)


def solve_constrained(weight: DoubleArray, product: DoubleArray, sigma: float, gamma: DoubleArray) -> DoubleArray:
    """The exact minimiser of Eqs. 8-9 under sum_i gamma_i c_i = 1, by a Lagrange multiplier, for any number of channels C.

    weight: sum l^2 over the sites of each channel, (..., C).
    product: sum l m over the sites of each channel, (..., C).
    sigma: sigma_z > 0, in the units of l.
    gamma: (C,), the weights of Eq. 7.
    Returns chromaticities, (..., C).
    """
    a = weight + sigma**2
    free = (product + sigma**2 / gamma.sum()) / a  # Eqs. 8-9 without the constraint, pulled towards grey
    pull = gamma / a
    missing = 1 - free @ gamma
    return free + pull * (missing / (pull @ gamma))[..., None]  # type: ignore[no-any-return]


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
        changed = oriented_median(before, after, columns, taps, changed)
        before, after = after, before
        iterations += 1
        progress.advance()
    progress.solved("medians", iterations, float(changed.mean()))
    return np.ascontiguousarray(before[:, :, half : half + columns].transpose(1, 2, 0))
