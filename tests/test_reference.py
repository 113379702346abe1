"""The reference, compared with other people's code and with the definitions."""

import numpy as np
import pytest
import pywt
from scipy import ndimage, optimize
from scipy.sparse import csr_array, diags_array

from panchroma.shared import CfaPattern, DoubleArray
from tests.reference import (
    affinity,
    chromaticity,
    gaussian,
    geometry,
    luminance,
    propagation,
    refinement,
)
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


def test_mirrored_is_the_border_of_numpy() -> None:
    for size in (1, 2, 3, 7):
        wide = np.pad(np.arange(size), 20, mode="reflect")
        assert [geometry.mirrored(place, size) for place in range(-20, size + 20)] == wide.tolist()


def test_geometry_of_the_papers_pattern() -> None:
    pattern = CfaPattern.bayer(6, origin=(2, 5))
    assert geometry.block(pattern) == (2, 5, 2, 2)
    assert geometry.first_patch(pattern) == (-3, 0)
    assert geometry.patch_counts(pattern, (9, 13)) == (2, 3)
    assert geometry.block_sites(pattern, (1, 1)) == [
        (2, 5, "R"),
        (2, 6, "G"),
        (3, 5, "G"),
        (3, 6, "B"),
    ]
    assert not geometry.is_whole(pattern, (9, 13), (1, 0))
    assert geometry.is_whole(pattern, (9, 13), (1, 1))
    assert not geometry.is_whole(pattern, (9, 12), (1, 2))


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
        errors = [
            np.abs(
                np.roll(theirs, (down, right), (0, 1))[
                    5 : 5 + interior.shape[0], 5 : 5 + interior.shape[1]
                ]
                / 2
                - interior
            ).max()
            for down in range(-4, 5)
            for right in range(-4, 5)
        ]
        assert min(errors) < ROUNDING


def test_shrinking_is_the_formula(random: np.random.Generator) -> None:
    band = random.normal(size=(5, 5))
    size = np.sqrt((band[1:4, 1:4] ** 2).sum())
    assert luminance.shrink(band, 0.5)[1, 1] == pytest.approx(
        band[2, 2] * (size - 0.5) / size, rel=1e-12
    )
    assert not luminance.shrink(band, 100.0).any()
    assert not luminance.shrink(np.zeros((5, 5)), 0.5).any()


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


def test_medians_are_those_of_ndimage(random: np.random.Generator) -> None:
    coarse = random.uniform(size=(6, 9, 2))
    lines = np.zeros((4, 5, 5), bool)
    lines[0, 2], lines[1, :, 2], lines[2], lines[3] = (
        True,
        True,
        np.eye(5, dtype=bool),
        np.eye(5, dtype=bool)[::-1],
    )
    for channel in range(2):
        theirs = [
            ndimage.median_filter(coarse[..., channel], footprint=line, mode="mirror")
            for line in lines
        ]
        for row in range(6):
            for column in range(9):
                ours = [value[channel] for value in chromaticity.proposals(coarse, row, column)]
                assert ours == [value[row, column] for value in theirs]


def test_medians_remove_an_outlier_and_keep_a_line() -> None:
    gamma = (1.0, 1.0)
    coarse = np.full((9, 9, 2), 0.5)
    coarse[4, 4] = 0.9, 0.1
    assert np.all(chromaticity.oriented_medians(coarse, gamma, 20) == 0.5)
    line = np.full((9, 9, 2), 0.5)
    line[4] = 0.9, 0.1
    assert_close(chromaticity.oriented_medians(line, gamma, 20), line, ROUNDING)


@pytest.mark.parametrize("sigma", [0.5, 0.75, 1.0, 2.0])
@pytest.mark.parametrize("shape", SIZES)
def test_gaussians_are_those_of_ndimage(
    random: np.random.Generator, shape: tuple[int, int], sigma: float
) -> None:
    picture = random.normal(size=shape)
    assert_close(
        gaussian.blur(picture, sigma),
        ndimage.gaussian_filter(picture, sigma, mode="mirror"),
        ROUNDING,
    )
    for axis, order in ((0, (1, 0)), (1, (0, 1))):
        theirs = ndimage.gaussian_filter(picture, sigma, order=order, mode="mirror")
        assert_close(gaussian.derivative(picture, sigma, axis), theirs, ROUNDING)


def test_edge_energy_is_one_on_average_and_zero_where_flat(random: np.random.Generator) -> None:
    area = random.uniform(size=(12, 18))
    area[:, 6:] = 0.3
    e = affinity.edges(area, 6, (0.5, 1.0), axis=1)
    assert e[:6, :6].mean() == pytest.approx(1.0)
    assert not e[:, 12:].any()


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


def test_refinement_is_the_sum_of_the_definition(random: np.random.Generator) -> None:
    period, h, std = 4, 0.2, 0.5
    light, initial = random.uniform(size=(7, 9)), random.uniform(size=(7, 9, 2))
    light[3, 4] = -0.1
    found = refinement.refine(initial, light, period, h=h, blur_periods=std / period, repetitions=1)
    kernel = gaussian.gaussian(std)
    for row, column in ((0, 0), (3, 4), (6, 3), (2, 8)):

        def l_at(y: int, x: int) -> float:
            return float(light[geometry.mirrored(y, 7), geometry.mirrored(x, 9)])

        weights, values = [], []
        for down in range(-2, 3):
            for right in range(-2, 3):
                distance = 0.0
                for y, weight_y in kernel.items():
                    for x, weight_x in kernel.items():
                        difference = l_at(row + y + down, column + x + right) - l_at(
                            row + y, column + x
                        )
                        distance += weight_y * weight_x * difference**2
                weights.append(
                    np.exp(-distance / (2 * h**2)) * max(l_at(row + down, column + right), 0.0)
                )
                values.append(
                    initial[geometry.mirrored(row + down, 7), geometry.mirrored(column + right, 9)]
                )
        expected = np.dot(weights, values) / sum(weights)
        assert_close(found[row, column], expected, ROUNDING)


def test_refinement_leaves_black_alone() -> None:
    initial = np.random.default_rng(5).uniform(size=(6, 6, 3))
    assert np.array_equal(
        refinement.refine(initial, np.zeros((6, 6)), 6, h=0.1, blur_periods=0.125, repetitions=3),
        initial,
    )
