"""Non-local averaging against its reference."""

from dataclasses import replace

import numpy as np
import pytest

from offline.measured import Measured
from offline.parts import Part, applied
from offline.stages.refinement import Refinement, RefinementSettings, noise_level, refine
from shared import CfaPattern, Mosaic, NoiseModel
from shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import CASES, every_case, gamma_of, materials, shot
from tests.reference import refinement as reference
from tests.reference.compare import assert_close
from tests.reference.render import sigma_of_light
from tests.reference.sensor import luminance_of

# Twice a sum of up to 81 float32 products of values up to four, divided by the sum of the weights.
FLOAT32 = 3e-6

PAPER = RefinementSettings()


def case(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None = 0.02) -> tuple[FloatArray, FloatArray, Mosaic]:
    initial = np.random.default_rng(6).uniform(0.1, 1.0, (*shape, len(pattern.channels)))
    light = luminance_of(materials(shape, len(pattern.channels)), gamma_of(pattern))
    return initial.astype(np.float32), light.astype(np.float32), shot(pattern, shape, sigma)


def refined(initial: FloatArray, light: FloatArray, mosaic: Mosaic, settings: RefinementSettings) -> FloatArray:
    period, sigma = mosaic.pattern.period, noise_level(light, mosaic.calibration.noise)
    return refine(Part(0, light, initial), (0, len(light)), light, period, sigma, settings)


def expected(initial: FloatArray, light: FloatArray, mosaic: Mosaic, settings: RefinementSettings) -> DoubleArray:
    h = max(settings.strength * sigma_of_light(mosaic, light.astype(np.float64)), settings.floor)
    return reference.refine(
        initial.astype(np.float64),
        light.astype(np.float64),
        mosaic.pattern.period,
        h=h,
        blur_periods=settings.blur,
        repetitions=settings.repetitions,
    )


@every_case
@pytest.mark.parametrize("sigma", [None, 0.0005, 0.02])
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> None:
    initial, light, mosaic = case(pattern, shape, sigma)
    found = refined(initial, light, mosaic, PAPER)
    assert found.dtype == np.float32
    assert_close(found, expected(initial, light, mosaic, PAPER), FLOAT32)


@pytest.mark.parametrize(
    "settings",
    [
        RefinementSettings(strength=0.0, floor=0.1),
        RefinementSettings(strength=3.0),
        RefinementSettings(blur=0.02),
        RefinementSettings(blur=0.5),
        RefinementSettings(repetitions=1),
        RefinementSettings(repetitions=4),
    ],
    ids=str,
)
def test_equals_the_reference_at_other_settings(settings: RefinementSettings) -> None:
    initial, light, mosaic = case(*CASES["odd"])
    assert_close(refined(initial, light, mosaic, settings), expected(initial, light, mosaic, settings), 2 * FLOAT32)


@pytest.mark.parametrize("rows", [1, 5, 8, 1000])
def test_bands_leave_no_trace(rows: int) -> None:
    initial, light, mosaic = case(*CASES["odd"])
    measured = Measured(mosaic.pattern, mosaic.calibration, light, initial)
    parts = (Part(0, light, initial).rows(top, min(top + rows, len(light))) for top in range(0, len(light), rows))
    found = [part.chromaticity for part in applied(parts, Refinement(measured, PAPER), len(light))]
    assert np.array_equal(np.concatenate(found), refined(initial, light, mosaic, PAPER))


def test_noise_is_panchromatic_noise_at_the_mean_luminance() -> None:
    initial, light, mosaic = case(*CASES["odd"])
    noise = NoiseModel((9.0, 9.0, 9.0, 3e-5), (9.0, 9.0, 9.0, 1e-3))
    loud = Mosaic(mosaic.signal, mosaic.pattern, replace(mosaic.calibration, noise=noise))
    found = refined(initial, light, loud, PAPER)
    assert_close(found, expected(initial, light, loud, PAPER), FLOAT32)
    sigma = float(np.hypot(1e-3, np.sqrt(3e-5 * light.mean(dtype=np.float64))))
    plain = Mosaic(mosaic.signal, mosaic.pattern, replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4)))
    assert_close(found, refined(initial, light, plain, PAPER), FLOAT32)


def test_no_repetitions_change_nothing() -> None:
    initial, light, mosaic = case(*CASES["odd"])
    assert np.array_equal(refined(initial, light, mosaic, RefinementSettings(repetitions=0)), initial)


def test_inputs_are_left_as_they_were() -> None:
    initial, light, mosaic = case(*CASES["odd"])
    copies = initial.copy(), light.copy()
    found = refined(initial, light, mosaic, PAPER)
    assert np.array_equal(initial, copies[0])
    assert np.array_equal(light, copies[1])
    assert not np.shares_memory(found, initial)
