"""Block chromaticities and oriented medians against their reference, and against the constraint of
Eq. 7.
"""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.stages.chromaticity import (
    ChromaticitySettings,
    estimate_chromaticities,
    sigma_z,
)
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import CASES, cleaned, every_case, gamma_of, sampled, shot, true_light
from tests.reference import chromaticity as reference
from tests.reference.compare import assert_close
from tests.reference.render import sigma_of_colour
from tests.reference.sensor import observe

# Solved in double, returned in float32: half a unit in the last place at values up to four.
FLOAT32 = 3e-7

PAPER = ChromaticitySettings()
NO_MEDIANS = ChromaticitySettings(repetitions=0)


def expected(mosaic: Mosaic, luminance: FloatArray, settings: ChromaticitySettings) -> DoubleArray:
    gamma = mosaic.calibration.gamma
    coarse = reference.estimate(
        mosaic.signal.astype(np.float64),
        luminance.astype(np.float64),
        mosaic.pattern,
        gamma,
        sigma_of_colour(mosaic),
    )
    coarse = reference.oriented_medians(coarse, gamma, settings.repetitions)
    return reference.extend(coarse, mosaic.pattern, mosaic.shape)


def light_of(mosaic: Mosaic) -> FloatArray:
    """The true luminance of `shot`, and some error, as hole filling makes it."""
    true = true_light(mosaic.pattern, mosaic.shape)
    return (true * np.random.default_rng(9).uniform(0.9, 1.1, true.shape)).astype(np.float32)


def assert_constraint(chromaticity: FloatArray, mosaic: Mosaic) -> None:
    """sum_i gamma_i c_i = 1, up to the rounding of each c_i to float32."""
    sums = chromaticity.astype(np.float64) @ np.array(mosaic.calibration.gamma)
    size = np.abs(chromaticity.astype(np.float64)) @ np.array(mosaic.calibration.gamma)
    assert (np.abs(sums - 1) <= np.finfo(np.float32).eps * size).all()


@every_case
@pytest.mark.parametrize("sigma", [None, 0.0, 0.05])
@pytest.mark.parametrize(
    "settings", [PAPER, NO_MEDIANS, ChromaticitySettings(1)], ids=["paper", "no medians", "once"]
)
def test_equals_the_reference(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None, settings: ChromaticitySettings
) -> None:
    mosaic = shot(pattern, shape, sigma)
    found = estimate_chromaticities(sampled(mosaic, light_of(mosaic)), settings)
    assert found.dtype == np.float32
    assert found.shape == (*pattern.grid(shape).shape, len(pattern.channels))
    assert_close(found, expected(mosaic, light_of(mosaic), settings), FLOAT32)
    assert_constraint(found, mosaic)


@every_case
@pytest.mark.parametrize("sigma", [None, 0.0, 0.02])
def test_blackness_is_grey(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None
) -> None:
    mosaic = observe(np.zeros((*shape, len(pattern.channels))), pattern, gamma_of(pattern), sigma)
    found = estimate_chromaticities(sampled(mosaic, np.zeros(shape, np.float32)), PAPER)
    assert_close(found, np.full(found.shape, mosaic.calibration.grey), FLOAT32)


def test_noise_is_that_of_the_colour_planes_at_the_mean_colour_sample() -> None:
    pattern, shape = CASES["odd"]
    noise = NoiseModel((0.2, 0.1, 0.3, 9.0), (0.1, 0.2, 0.05, 9.0))
    dark = shot(pattern, shape, None)
    mosaic = Mosaic(dark.signal, pattern, replace(dark.calibration, noise=noise))
    # The mean of the channels' means and the mean of all samples differ by what the greens, of
    # which there are two, differ.
    assert sigma_z(cleaned(mosaic)) == pytest.approx(sigma_of_colour(mosaic), rel=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_wild_estimates_stay_finite_and_on_the_constraint(seed: int) -> None:
    """Black frames of pure noise that the calibration denies: chromaticities of any size and
    sign.
    """
    random = np.random.default_rng(seed)
    pattern = CfaPattern.bayer(3)
    samples = random.normal(scale=0.1, size=(40, 41)).astype(np.float32)
    mosaic = Mosaic(samples, pattern, SensorCalibration())
    light = random.normal(scale=0.01, size=mosaic.shape).astype(np.float32)
    found = estimate_chromaticities(sampled(mosaic, light), PAPER)
    assert np.isfinite(found).all()
    assert_constraint(found, mosaic)
    # Scaling a median that lies nearly across the constraint's plane would throw it far out (seed
    # 4: a thousand times).
    before = estimate_chromaticities(sampled(mosaic, light), NO_MEDIANS)
    assert 10 < np.abs(found).max() <= np.abs(before).max()
