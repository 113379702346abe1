"""Non-local averaging against its reference."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.bands import Band
from panchroma.offline.frame import Frame
from panchroma.offline.stages.refinement import Refinement, RefinementSettings
from panchroma.shared import CfaPattern, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import CASES, cleaned, every_case, shot, true_light
from tests.reference import refinement as reference
from tests.reference.compare import assert_close
from tests.reference.render import sigma_of_light

# Twice a sum of up to 81 float32 products of values up to four, divided by the sum of the weights.
FLOAT32 = 3e-6

PAPER = RefinementSettings()


def case(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None = 0.02
) -> tuple[FloatArray, Frame]:
    """Any chromaticities, and a frame with luminance."""
    initial = np.random.default_rng(6).uniform(0.1, 1.0, (*shape, len(pattern.channels)))
    frame = replace(cleaned(shot(pattern, shape, sigma)), luminance=true_light(pattern, shape))
    return initial.astype(np.float32), frame


def refined(initial: FloatArray, frame: Frame, settings: RefinementSettings) -> FloatArray:
    rows = 0, frame.shape[0]
    return Refinement(frame, settings)(Band(0, frame.luminance, initial), rows).chromaticity


def expected(initial: FloatArray, frame: Frame, settings: RefinementSettings) -> DoubleArray:
    light = frame.luminance.astype(np.float64)
    return reference.refine(
        initial.astype(np.float64),
        light,
        frame.pattern.period,
        h=max(settings.strength * sigma_of_light(frame.mosaic, light), settings.floor),
        blur_periods=settings.blur,
        repetitions=settings.repetitions,
    )


@every_case
@pytest.mark.parametrize("sigma", [None, 0.0005, 0.02])
def test_equals_the_reference(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None
) -> None:
    initial, frame = case(pattern, shape, sigma)
    found = refined(initial, frame, PAPER)
    assert found.dtype == np.float32
    assert_close(found, expected(initial, frame, PAPER), FLOAT32)


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
    initial, frame = case(*CASES["odd"])
    found = refined(initial, frame, settings)
    assert_close(found, expected(initial, frame, settings), 2 * FLOAT32)


def test_noise_is_panchromatic_noise_at_the_mean_luminance() -> None:
    _, frame = case(*CASES["odd"])
    noise = NoiseModel((9.0, 9.0, 9.0, 3e-5), (9.0, 9.0, 9.0, 1e-3))
    loud = replace(frame.mosaic, calibration=replace(frame.mosaic.calibration, noise=noise))
    sigma = float(np.hypot(1e-3, np.sqrt(3e-5 * frame.luminance.mean(dtype=np.float64))))
    assert Refinement(replace(frame, mosaic=loud), PAPER).sigma == pytest.approx(sigma)


@pytest.mark.parametrize("repetitions", [1, 3])
@pytest.mark.parametrize(
    ("period", "shape"),
    [(6, (3, 40)), (4, (16, 17)), (6, (131, 283)), (16, (45, 300)), (16, (3, 5))],
)
def test_equals_the_reference_in_tiles(
    period: int, shape: tuple[int, int], repetitions: int
) -> None:
    """Frames of several tiles, and windows larger than the frame."""
    initial, frame = case(CfaPattern.bayer(period), shape)
    settings = RefinementSettings(strength=10.0, repetitions=repetitions)
    found = refined(initial, frame, settings)
    assert_close(found, expected(initial, frame, settings), 2 * FLOAT32)


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_the_dark_is_left_as_it_was(value: float) -> None:
    """Where the window has no light, and only there; nearby light counts however little it
    resembles.
    """
    initial, frame = case(CfaPattern.bayer(6), (40, 50))
    frame.luminance[:, :25] = value
    assert np.array_equal(refined(initial, frame, PAPER)[:, :22], initial[:, :22])
    # So narrow a window that no weight is left: as in exact arithmetic, where they are smaller than
    # any number.
    narrow = RefinementSettings(strength=0.0, floor=1e-4, repetitions=1)
    assert np.array_equal(refined(initial, frame, narrow)[:, :25], initial[:, :25])
