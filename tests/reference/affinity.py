"""Eqs. 11-13: material affinities, one harmonic field per parity class of the block grid (errata:
"three maps of every four").
"""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from panchroma.shared import CfaPattern, DoubleArray, IndexArray
from tests.reference.geometry import block_sites, first_patch, patch_counts


def padded(luminance: DoubleArray, pattern: CfaPattern) -> DoubleArray:
    """Luminance of the padded frame: the frame, mirrored out to whole patches."""
    height, width = luminance.shape
    (top, left), (down, across) = first_patch(pattern), patch_counts(pattern, (height, width))
    below, right = top + down * pattern.period - height, left + across * pattern.period - width
    return np.pad(luminance, ((-top, below), (-left, right)), mode="reflect")


def edges(area: DoubleArray, period: int, scales: tuple[float, ...], axis: int) -> DoubleArray:
    """e_h (axis 1) or e_v (axis 0) of Eq. 13, divided by the mean of the K x K patch; zero in a
    patch without gradients.
    """
    order = [int(each == axis) for each in (0, 1)]
    slopes = (gaussian_filter(area, scale, order, mode="mirror") for scale in scales)
    energy = sum((slope**2 for slope in slopes), np.zeros_like(area))
    result = np.zeros_like(energy)
    for top in range(0, area.shape[0], period):
        for left in range(0, area.shape[1], period):
            patch = energy[top : top + period, left : left + period]
            if patch.mean() > 0:
                result[top : top + period, left : left + period] = patch / patch.mean()
    return result


def weights(area: DoubleArray, period: int, scales: tuple[float, ...]) -> csr_array:
    """c[n, n'] of Eq. 12 for all neighbours n, n' of the padded frame, symmetric."""
    height, width = area.shape
    e_h, e_v = (edges(area, period, scales, axis) for axis in (1, 0))
    e_d = np.maximum(e_h, e_v)
    here, rows, columns, values = np.arange(area.size).reshape(area.shape), [], [], []
    for down, right, e in ((0, 1, e_h), (1, 0, e_v), (1, 1, e_d), (1, -1, e_d)):
        one = slice(0, height - down), slice(max(0, -right), width - max(0, right))
        other = slice(down, height), slice(max(0, right), width + min(0, right))
        weight = np.exp(-np.maximum(e[one], e[other])).ravel()  # Eq. 12
        rows += [here[one].ravel(), here[other].ravel()]
        columns += [here[other].ravel(), here[one].ravel()]
        values += [weight, weight]
    places = np.concatenate(rows), np.concatenate(columns)
    return csr_array(coo_array((np.concatenate(values), places), shape=(area.size, area.size)))


def pins(pattern: CfaPattern, shape: tuple[int, int]) -> dict[tuple[int, int], tuple[int, int]]:
    """Pixel of the padded frame -> index of its block, for the colour sites of all blocks."""
    (top, left), (down, across) = first_patch(pattern), patch_counts(pattern, shape)
    places = {
        (row - top, column - left): index
        for index in np.ndindex(down + 1, across + 1)
        for row, column, _ in block_sites(pattern, index)
    }
    height, width = down * pattern.period, across * pattern.period
    return {
        (row, column): index
        for (row, column), index in places.items()
        if 0 <= row < height and 0 <= column < width
    }


def harmonic(neighbours: csr_array, known: IndexArray, values: DoubleArray) -> DoubleArray:
    """The minimisers of Eq. 11, (pixels, columns of `values`), solved directly.

    neighbours: c[n, n'], symmetric, from `weights`.
    known, values: pixel indices, ascending, and the values that each minimiser is given there.
    """
    size = neighbours.shape[0]
    free = np.setdiff1d(np.arange(size), known)
    laplacian = csr_array(diags_array(np.asarray(neighbours.sum(axis=1)).ravel()) - neighbours)
    result = np.empty((size, values.shape[1]))
    result[known] = values
    # The matrix is symmetric and diagonally dominant, so no pivoting is needed.
    factors = splu(
        csc_array(laplacian[free][:, free]),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    result[free] = factors.solve(neighbours[free][:, known] @ values)
    return result


def fields(luminance: DoubleArray, pattern: CfaPattern, scales: tuple[float, ...]) -> DoubleArray:
    """All four parity fields (2, 2, rows, columns)."""
    area = padded(luminance, pattern)
    blocks = sorted(pins(pattern, (luminance.shape[0], luminance.shape[1])).items())
    known = np.array([y * area.shape[1] + x for (y, x), _ in blocks])
    own = np.array(
        [[float((i % 2, j % 2) == parity) for parity in np.ndindex(2, 2)] for _, (i, j) in blocks]
    )
    found = harmonic(weights(area, pattern.period, scales), known, own)
    return found.T.reshape(2, 2, *area.shape)
