"""Eqs. 11-13: material affinities, one harmonic field per parity class of the block grid (errata: "three maps of every four")."""

import math

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import cg

from shared import CfaPattern
from shared.arrays import DoubleArray
from tests.reference.gaussian import derivative
from tests.reference.geometry import block_sites, first_patch, mirrored, patch_counts

# Far below any difference that the tests look for, well above the rounding of float64 sums of a few thousand terms.
RESIDUAL = 1e-12


def domain(luminance: DoubleArray, pattern: CfaPattern) -> DoubleArray:
    """Luminance of the domain: the frame, mirrored out to whole patches."""
    (top, left), (down, across) = first_patch(pattern), patch_counts(pattern, (luminance.shape[0], luminance.shape[1]))
    rows = [mirrored(top + y, luminance.shape[0]) for y in range(down * pattern.period)]
    columns = [mirrored(left + x, luminance.shape[1]) for x in range(across * pattern.period)]
    area: DoubleArray = luminance[np.ix_(rows, columns)]
    return area


def edges(area: DoubleArray, period: int, scales: tuple[float, ...], axis: int) -> DoubleArray:
    """e_h (axis 1) or e_v (axis 0) of Eq. 13, divided by the mean of the K x K patch; zero in a patch without gradients."""
    energy = sum((derivative(area, scale, axis) ** 2 for scale in scales), np.zeros_like(area))
    result = np.zeros_like(energy)
    for top in range(0, area.shape[0], period):
        for left in range(0, area.shape[1], period):
            patch = energy[top : top + period, left : left + period]
            if patch.mean() > 0:
                result[top : top + period, left : left + period] = patch / patch.mean()
    return result


def weights(area: DoubleArray, period: int, scales: tuple[float, ...]) -> csr_array:
    """c[n, n'] of Eq. 12 for all neighbours n, n' of the domain, symmetric."""
    height, width = area.shape
    e_h, e_v = (edges(area, period, scales, axis) for axis in (1, 0))
    e_d = np.maximum(e_h, e_v)
    rows, columns, values = [], [], []
    for y in range(height):
        for x in range(width):
            for down, right, e in ((0, 1, e_h), (1, 0, e_v), (1, 1, e_d), (1, -1, e_d)):
                other = y + down, x + right
                if other[0] < height and 0 <= other[1] < width:
                    weight = math.exp(-max(e[y, x], e[other]))  # Eq. 12
                    here, there = y * width + x, other[0] * width + other[1]
                    rows += [here, there]
                    columns += [there, here]
                    values += [weight, weight]
    return csr_array(coo_array((values, (rows, columns)), shape=(area.size, area.size)))


def pins(pattern: CfaPattern, shape: tuple[int, int]) -> dict[tuple[int, int], tuple[int, int]]:
    """Domain pixel -> index of its block, for the colour sites of all blocks."""
    (top, left), (down, across) = first_patch(pattern), patch_counts(pattern, shape)
    found = {}
    for i in range(down + 1):
        for j in range(across + 1):
            for row, column, _ in block_sites(pattern, (i, j)):
                place = row - top, column - left
                if 0 <= place[0] < down * pattern.period and 0 <= place[1] < across * pattern.period:
                    found[place] = i, j
    return found


def harmonic(neighbours: csr_array, fixed: dict[int, float]) -> DoubleArray:
    """The minimiser of Eq. 11, one value per pixel, by conjugate gradients.

    neighbours: c[n, n'], symmetric, from `weights`.
    fixed: pixel index -> its given value.
    """
    size = neighbours.shape[0]
    result = np.zeros(size)
    known = np.array(sorted(fixed))
    free = np.setdiff1d(np.arange(size), known)
    result[known] = [fixed[int(place)] for place in known]
    degree = np.asarray(neighbours.sum(axis=1)).ravel()
    laplacian = csr_array(diags_array(degree) - neighbours)
    system = csr_array(laplacian[free][:, free])
    right = neighbours[free][:, known] @ result[known]
    scale = 1 / degree[free]  # Jacobi preconditioner: pixels behind strong edges count as much as all others
    solution, status = cg(system, right, rtol=RESIDUAL, atol=0.0, maxiter=20 * size, M=diags_array(scale))
    if status != 0:
        raise RuntimeError(f"the reference did not converge: {status}")
    result[free] = solution
    return result


def fields(luminance: DoubleArray, pattern: CfaPattern, scales: tuple[float, ...]) -> DoubleArray:
    """All four parity fields (2, 2, rows, columns), each solved separately."""
    area = domain(luminance, pattern)
    neighbours = weights(area, pattern.period, scales)
    blocks = pins(pattern, (luminance.shape[0], luminance.shape[1]))
    result = np.empty((2, 2, *area.shape))
    for p in range(2):
        for q in range(2):
            fixed = {
                place[0] * area.shape[1] + place[1]: float((index[0] % 2, index[1] % 2) == (p, q))
                for place, index in blocks.items()
            }
            result[p, q] = harmonic(neighbours, fixed).reshape(area.shape)
    return result
