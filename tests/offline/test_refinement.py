"""Non-local averaging against its reference."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.bands import Band
from panchroma.offline.stages.refinement import RefinementSettings, noise_level, refine
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import CASES, every_case, gamma_of, materials, shot
from tests.reference import refinement as reference
from tests.reference.compare import assert_close
from tests.reference.render import sigma_of_light
from tests.reference.sensor import luminance_of

# Twice a sum of up to 81 float32 products of values up to four, divided by the sum of the weights.
FLOAT32 = 3e-6

PAPER = RefinementSettings()


def case(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None = 0.02
) -> tuple[FloatArray, FloatArray, Mosaic]:
    initial = np.random.default_rng(6).uniform(0.1, 1.0, (*shape, len(pattern.channels)))
    light = luminance_of(materials(shape, len(pattern.channels)), gamma_of(pattern))
    return initial.astype(np.float32), light.astype(np.float32), shot(pattern, shape, sigma)


def refined(
    initial: FloatArray, light: FloatArray, mosaic: Mosaic, settings: RefinementSettings
) -> FloatArray:
    period, sigma = mosaic.pattern.period, noise_level(light, mosaic.calibration.noise)
    return refine(Band(0, light, initial), (0, len(light)), light, period, sigma, settings)


def expected(
    initial: FloatArray, light: FloatArray, mosaic: Mosaic, settings: RefinementSettings
) -> DoubleArray:
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
def test_equals_the_reference(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None
) -> None:
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
    assert_close(
        refined(initial, light, mosaic, settings),
        expected(initial, light, mosaic, settings),
        2 * FLOAT32,
    )


def test_noise_is_panchromatic_noise_at_the_mean_luminance() -> None:
    initial, light, mosaic = case(*CASES["odd"])
    noise = NoiseModel((9.0, 9.0, 9.0, 3e-5), (9.0, 9.0, 9.0, 1e-3))
    loud = Mosaic(mosaic.signal, mosaic.pattern, replace(mosaic.calibration, noise=noise))
    found = refined(initial, light, loud, PAPER)
    assert_close(found, expected(initial, light, loud, PAPER), FLOAT32)
    sigma = float(np.hypot(1e-3, np.sqrt(3e-5 * light.mean(dtype=np.float64))))
    plain = Mosaic(
        mosaic.signal,
        mosaic.pattern,
        replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4)),
    )
    assert_close(found, refined(initial, light, plain, PAPER), FLOAT32)


def test_no_repetitions_change_nothing() -> None:
    initial, light, mosaic = case(*CASES["odd"])
    assert np.array_equal(
        refined(initial, light, mosaic, RefinementSettings(repetitions=0)), initial
    )


@pytest.mark.parametrize("repetitions", [1, 3])
@pytest.mark.parametrize(
    ("shape", "period", "blur", "channels"),
    [
        ((1, 1), 3, 1 / 8, 3),
        ((3, 40), 6, 1 / 8, 2),
        ((16, 17), 4, 1 / 8, 5),
        ((131, 283), 6, 1 / 8, 3),
        ((45, 300), 16, 1 / 8, 3),
        ((5, 5), 16, 1 / 8, 3),
    ],
)
def test_equals_the_reference_in_tiles(
    shape: tuple[int, int], period: int, blur: float, channels: int, repetitions: int
) -> None:
    """Frames of several tiles, and windows larger than the frame."""
    random, (row, column) = np.random.default_rng(0), np.indices(shape)
    light = (
        0.6 + 0.4 * np.sin(row / 6.0) * np.cos(column / 9.0) + random.normal(0, 0.05, shape)
    ).astype(np.float32)
    initial = random.uniform(0.1, 1.0, (*shape, channels)).astype(np.float32)
    settings = RefinementSettings(strength=1.0, blur=blur, repetitions=repetitions)
    right = reference.refine(
        initial.astype(np.float64),
        light.astype(np.float64),
        period,
        h=0.2,
        blur_periods=blur,
        repetitions=repetitions,
    )
    assert_close(
        refine(Band(0, light, initial), (0, shape[0]), light, period, 0.2, settings),
        right,
        2 * FLOAT32,
    )


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_the_dark_is_left_as_it_was(value: float) -> None:
    """Where the window has no light, and only there; nearby light counts however little it
    resembles.
    """
    initial, light, mosaic = case(CfaPattern.bayer(6), (40, 50))
    light[:, :25] = value
    assert np.array_equal(refined(initial, light, mosaic, PAPER)[:, :22], initial[:, :22])
    # So narrow a window that no weight is left: as in exact arithmetic, where they are smaller than
    # any number.
    narrow = RefinementSettings(strength=0.0, floor=1e-4, repetitions=1)
    assert np.array_equal(refined(initial, light, mosaic, narrow)[:, :25], initial[:, :25])
