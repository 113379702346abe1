"""The forward model: what each pixel reads, and noise that has the moments it is said to have.

Bounds on moments are five standard errors of what is estimated: a right model fails one run in a
million, and the seed is fixed.
"""

import math
from typing import Any

import numpy as np
import pytest

from panchroma.shared import CfaPattern, DoubleArray, FloatArray, NoiseModel, SensorCalibration
from panchroma.tools.simulation.sensor import sample, simulate_additive, simulate_sensor
from tests.offline.scenes import every_case, gamma_of, materials
from tests.reference.sensor import observe

ERRORS = 5  # standard errors
SHAPE = (240, 246)
PATTERN = CfaPattern.bayer(6, origin=(1, 4))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def flat(*channels: float) -> FloatArray:
    return np.full((*SHAPE, len(channels)), channels, np.float32)


def of_filter(letter: str, samples: Any) -> DoubleArray:
    """The samples under a filter of `PATTERN`."""
    return np.asarray(samples[PATTERN.filter_map(SHAPE) == "RGBW".index(letter)], float)


def assert_moments(values: DoubleArray, mean: float, variance: float) -> None:
    """Mean and variance of many independent samples of a nearly normal distribution."""
    assert abs(values.mean() - mean) < ERRORS * math.sqrt(variance / values.size)
    assert abs(values.var() - variance) < ERRORS * variance * math.sqrt(2 / values.size)


# --- what a pixel reads --------------------------------------------------------------------------


@every_case
def test_a_pixel_reads_one_channel_or_the_weighted_sum(
    pattern: CfaPattern, shape: tuple[int, int]
) -> None:
    scene = materials(shape, len(pattern.channels))
    calibration = SensorCalibration(pattern.channels, gamma_of(pattern))
    samples = sample(scene.astype(np.float32), pattern, calibration)
    expected = observe(scene, pattern, gamma_of(pattern)).samples
    np.testing.assert_allclose(samples, expected, rtol=1e-6)


# --- the paper's noise ---------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.01, 0.3])
def test_additive_noise_has_its_sigma_on_every_plane_and_is_not_clipped(sigma: float) -> None:
    light = {"R": 0.0, "G": 1.0, "B": 0.5, "W": 1.5}
    mosaic = simulate_additive(flat(0.0, 1.0, 0.5), PATTERN, SensorCalibration(), sigma, rng())
    for letter, value in light.items():
        assert_moments(of_filter(letter, mosaic.signal), value, sigma**2)
    assert mosaic.samples.dtype == np.float32
    assert of_filter("R", mosaic.signal).min() < 0  # not clipped at black
    assert mosaic.calibration.noise == NoiseModel.gaussian(sigma, 4)


# --- the noise of a sensor -----------------------------------------------------------------------

# Sixteen bits, so that rounding to codes adds a variance (step**2 / 12) that is little beside the
# noise, and is known.
NOISE = NoiseModel((0.002, 0.001, 0.003, 0.0015), (0.02, 0.03, 0.01, 0.015))
SENSOR = SensorCalibration.of_bits(16, gamma=(0.9, 1.0, 1.1), noise=NOISE)
BLACK, WHITE = SENSOR.black_level[0], SENSOR.white_level
ROUNDING = (SENSOR.full_scale / (WHITE - BLACK)) ** 2 / 12


@pytest.mark.parametrize(("red", "green", "blue"), [(0.2, 0.5, 0.4), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("exposure", [0.5, 1.0, 2.0])
def test_sensor_noise_is_shot_noise_and_read_noise_of_each_plane(
    red: float, green: float, blue: float, exposure: float
) -> None:
    """In the dark it goes below black, and the black level keeps it."""
    mosaic = simulate_sensor(flat(red, green, blue), PATTERN, SENSOR, exposure, rng())
    values = (red, green, blue, red * 0.9 + green + blue * 1.1)
    for plane, value in enumerate(values):
        signal = value * exposure
        measured = of_filter("RGBW"[plane], mosaic.signal)
        assert_moments(measured, signal, NOISE.sigma(signal, plane) ** 2 + ROUNDING)
    assert mosaic.samples.dtype == np.uint16
    assert mosaic.calibration == SENSOR


def test_light_is_clipped_at_full_scale_not_above() -> None:
    mosaic = simulate_sensor(flat(2.0, 0.5, 0.5), PATTERN, SENSOR, 2.0, rng())
    assert mosaic.codes.max() == WHITE
    assert (of_filter("R", mosaic.codes) == WHITE).all()  # 4.0 of 3.0
    assert (of_filter("G", mosaic.codes) < WHITE).all()  # 1.0 of 3.0
