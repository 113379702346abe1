"""Fields that fit samples, against what SciPy solves directly."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from panchroma.offline.numerics.linked import SIDE, Fit, fitted
from panchroma.shared.arrays import DoubleArray

HALO = 16
FIT = Fit(0.1, 1e-3, 0.3, HALO, 1e-5)


def laplacian(luminance: DoubleArray) -> sparse.csr_array:
    """The prior of the docstring as a matrix."""
    (height, width), place = luminance.shape, np.arange(luminance.size).reshape(luminance.shape)
    total = sparse.csr_array((place.size, place.size))
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: height - down, max(-right, 0) : width - max(right, 0)]
        there = np.s_[down:, max(right, 0) : width + min(right, 0)]
        steps = (luminance[here] - luminance[there]) / FIT.edge
        tie = (FIT.smoothness / (1 + down * abs(right)) / (1 + steps**2)).ravel()
        ones, ties = np.ones(tie.size), np.arange(tie.size)
        ends = np.r_[place[here].ravel(), place[there].ravel()]
        entries = np.r_[ones, -ones], (np.r_[ties, ties], ends)
        difference = sparse.csr_array(entries, (tie.size, place.size))
        total = total + difference.T @ sparse.diags_array(tie) @ difference
    return total


@pytest.mark.parametrize("fields", [2, 3, 5])
@pytest.mark.parametrize("shape", [(HALO + 5, 30), (SIDE + 8, 20), (20, SIDE + 8)])
def test_fields_are_the_minimum_of_the_sum_of_squares(fields: int, shape: tuple[int, int]) -> None:
    random = np.random.default_rng(0)
    luminance, weights = random.uniform(0.1, 1, shape), random.uniform(0, 1, (fields, *shape))
    weights *= random.uniform(0, 1, weights.shape) < 0.5
    products = weights * random.uniform(-0.5, 0.5, weights.shape)
    plane, wide, sums = (plane.astype(np.float32) for plane in (luminance, weights, products))
    found = fitted(plane, wide, sums, FIT, (0, shape[0]))
    for weight, product, field in zip(weights, products, found, strict=True):
        matrix = laplacian(luminance) + sparse.diags_array(weight.ravel() + FIT.fading)
        exact = spsolve(matrix.tocsc(), product.ravel()).reshape(shape)
        assert np.abs(field - exact).max() < 1e-2 * np.abs(exact).max()  # chunks end at their halo
        assert np.abs(field - exact)[:8, :8].max() < 1e-3 * np.abs(exact).max()
