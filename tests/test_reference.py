"""The reference, compared with other people's code and with the definitions."""

from itertools import product

import numpy as np
import pytest
import pywt
from scipy import optimize
from scipy.sparse import csr_array, diags_array

from panchroma.shared import CfaPattern, DoubleArray
from tests.reference import affinity, chromaticity, geometry, luminance, propagation
from tests.reference.compare import assert_close

ROUNDING = 1e-12  # float64 sums of at most a few hundred terms of size one
SOLVED = 1e-9  # the rounding of a direct solution times the condition number of systems this small
SIZES = [(1, 7), (2, 3), (9, 16), (23, 18)]


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(2014)


@pytest.mark.parametrize(
    "wrong",
    [np.array([1.0, 2.1]), np.array([1.0, np.nan]), np.array([1.0, np.inf]), np.array([1.0])],
)
def test_the_comparison_can_fail(wrong: DoubleArray) -> None:
    assert_close(np.array([1.0, 2.0]), np.array([1.0, 2.0]), 0.0)
    with pytest.raises(AssertionError):
        assert_close(wrong, np.array([1.0, 2.0]), 0.05)
    with pytest.raises(AssertionError):
        assert_close(np.array([1.0, 2.0]), wrong, 0.05)


@pytest.mark.parametrize("shape", SIZES)
def test_synthesis_undoes_analysis(random: np.random.Generator, shape: tuple[int, int]) -> None:
    picture = random.normal(size=shape)
    bands = [band[1:-1, 1:-1] for band in luminance.analyse(picture)]
    assert_close(luminance.synthesise(bands), picture, ROUNDING)


def test_filters_are_a_tight_frame() -> None:
    spectra = [np.abs(np.fft.fft2(np.outer(*taps), (16, 16))) ** 2 for taps in luminance.filters()]
    assert_close(np.sum(spectra, axis=0), np.ones((16, 16)), ROUNDING)


def test_analysis_is_the_undecimated_transform_of_pywavelets(random: np.random.Generator) -> None:
    picture = random.normal(size=(24, 32))
    ((low, others),) = pywt.swt2(picture, "db2", level=1)
    swapped = [low, others[1], others[0], others[2]]  # ours: low-high is low down, high across
    for band, theirs in zip(luminance.analyse(picture), swapped, strict=True):
        interior = band[5:-5, 5:-5]  # the borders differ: swt2 is periodic
        height, width = interior.shape
        shifted = (np.roll(theirs, shift, (0, 1)) for shift in product(range(-4, 5), repeat=2))
        windows = (picture[5 : 5 + height, 5 : 5 + width] / 2 for picture in shifted)
        assert min(np.abs(window - interior).max() for window in windows) < ROUNDING


def test_block_solution_is_the_constrained_minimum(random: np.random.Generator) -> None:
    gamma, sigma = (0.7, 1.1, 1.3), 0.2
    samples = [random.uniform(size=count).tolist() for count in (1, 2, 1)]
    lights = [random.uniform(size=count).tolist() for count in (1, 2, 1)]

    def cost(c: DoubleArray) -> float:
        data = sum(
            (light * c[i] - m) ** 2
            for i in range(3)
            for light, m in zip(lights[i], samples[i], strict=True)
        )
        return float(data + sigma**2 * ((c - 1 / sum(gamma)) ** 2).sum())  # Eqs. 8-9

    constraint = optimize.LinearConstraint(np.array([gamma]), 1.0, 1.0)
    found = optimize.minimize(
        cost, np.zeros(3), constraints=constraint, method="SLSQP", options={"ftol": 1e-15}
    ).x
    # a numerical minimum
    assert_close(chromaticity.solve_block(samples, lights, gamma, sigma), found, 1e-6)


def test_medians_remove_an_outlier_and_keep_a_line() -> None:
    gamma = (1.0, 1.0)
    coarse = np.full((9, 9, 2), 0.5)
    coarse[4, 4] = 0.9, 0.1
    assert np.all(chromaticity.oriented_medians(coarse, gamma, 20) == 0.5)
    line = np.full((9, 9, 2), 0.5)
    line[4] = 0.9, 0.1
    assert_close(chromaticity.oriented_medians(line, gamma, 20), line, ROUNDING)


def test_fields_are_harmonic_sum_to_one_and_stay_within_bounds(random: np.random.Generator) -> None:
    pattern = CfaPattern.bayer(5, origin=(3, 1))
    light = random.uniform(size=(17, 14))
    found = affinity.fields(light, pattern, (0.5, 1.0))
    assert_close(found.sum(axis=(0, 1)), np.ones(found.shape[2:]), SOLVED)
    assert found.min() >= -SOLVED
    assert found.max() <= 1 + SOLVED
    neighbours = affinity.weights(affinity.padded(light, pattern), 5, (0.5, 1.0))
    assert abs(neighbours - neighbours.T).max() == 0
    laplacian = csr_array(diags_array(np.asarray(neighbours.sum(axis=1)).ravel()) - neighbours)
    pins = affinity.pins(pattern, (17, 14))
    free = np.array([place not in pins for place in np.ndindex(found.shape[2:])])
    for p, q in np.ndindex(2, 2):
        field = found[p, q].ravel()
        assert np.abs((laplacian @ field)[free]).max() < SOLVED
        for place, index in pins.items():
            assert found[p, q][place] == ((index[0] % 2, index[1] % 2) == (p, q))


def test_propagation_is_bilinear_in_blocks_and_convex(random: np.random.Generator) -> None:
    pattern = CfaPattern.bayer(4, origin=(1, 2))
    light = random.uniform(size=(9, 11))
    alpha = affinity.fields(light, pattern, (0.5,))
    down, across = geometry.patch_counts(pattern, light.shape)
    blocks = random.uniform(size=(down + 1, across + 1, 3))
    found = propagation.propagate(blocks, alpha, light, pattern)
    assert blocks.min() <= found.min()
    assert found.max() <= blocks.max()
    one = propagation.propagate(np.ones_like(blocks), alpha, light, pattern)
    assert_close(one, np.ones_like(one), ROUNDING)
    top, left = geometry.first_patch(pattern)
    # its last site is the first pixel of a patch: there its own field is one and the others' are
    # zero
    index = 1, 1
    row, column = top + 4 * index[0], left + 4 * index[1]
    assert_close(found[row, column], blocks[index], ROUNDING)
