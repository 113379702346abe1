"""The reference, compared with other people's code and with the definitions."""

from itertools import product

import numpy as np
import pytest
import pywt
from scipy import ndimage, optimize

from panchroma.shared import DoubleArray
from tests.reference import (
    chromaticity,
    gaussian,
    luminance,
)
from tests.reference.compare import assert_close

ROUNDING = 1e-12  # float64 sums of at most a few hundred terms of size one
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
