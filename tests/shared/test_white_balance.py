"""The white balance: estimated from the blocks of a mosaic, and put into a calibration."""

import numpy as np
import pytest

from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.colorimetry import D50, SRGB_TO_XYZ
from panchroma.shared.white_balance import balanced, estimate_neutral
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.sensor import simulate_additive

CAMERA = SensorCalibration.of_bits(12)
LIGHT = (0.45, 1.0, 0.62)


def shot(
    light: tuple[float, ...] = LIGHT,
    level: float = 0.8,
    period: int = 6,
    origin: tuple[int, int] = (0, 0),
) -> Mosaic:
    """A grey scene of all brightnesses under a coloured light."""
    grey = np.random.default_rng(0).uniform(0.05, 1, (15, 20, 1)).repeat(10, 0).repeat(10, 1)
    rgb = (level * grey * np.array(light)).astype(np.float32)
    pattern, random = CfaPattern.bayer(period, origin=origin), np.random.default_rng(1)
    return simulate_additive(rgb, pattern, CAMERA, 0.002, random)


@pytest.mark.parametrize("origin", [(0, 0), (5, 0), (3, 5)])
@pytest.mark.parametrize("period", [4, 6])
def test_the_estimate_is_the_light_wherever_the_blocks_lie(
    period: int, origin: tuple[int, int]
) -> None:
    assert estimate_neutral(shot(period=period, origin=origin)) == pytest.approx(LIGHT, abs=0.05)


def test_codes_and_scene_units_give_the_same_estimate() -> None:
    mosaic = shot()
    codes = Mosaic(mosaic.codes, mosaic.pattern, mosaic.calibration)
    expected = estimate_neutral(codes.in_scene_units())
    assert estimate_neutral(codes) == pytest.approx(expected, abs=1e-5)


def test_hot_pixels_are_not_the_light() -> None:
    mosaic = shot()
    samples = mosaic.signal.copy()
    rows, columns = mosaic.pattern.lattices[0][1:]
    samples[rows, columns][::5, ::7] = 2.5
    found = estimate_neutral(Mosaic(samples, mosaic.pattern, CAMERA))
    assert found == pytest.approx(LIGHT, abs=0.03)


@pytest.mark.parametrize("level", [0.0, 0.005, 50.0])
def test_a_frame_that_shows_no_light_has_no_estimate(level: float) -> None:
    assert estimate_neutral(shot(level=level)) is None


@pytest.mark.parametrize("matrix", [None, tuple(map(tuple, SRGB_TO_XYZ / np.array(LIGHT)))])
def test_a_balanced_calibration_shows_its_neutral_as_grey(
    matrix: tuple[tuple[float, ...], ...] | None,
) -> None:
    known = SensorCalibration.of_bits(12, camera_to_xyz=matrix, neutral=LIGHT if matrix else None)
    other = balanced(known, np.array((0.9, 0.6, 0.3)))
    transform = ColourTransform.to_space(other, "linear-srgb")
    seen = transform.apply(np.array([[other.neutral]], np.float32))
    assert np.ptp(seen) < 1e-5
    assert other.neutral == pytest.approx((1.0, 0.6 / 0.9, 0.3 / 0.9))
    if other.camera_to_xyz is not None:
        white = np.array(other.camera_to_xyz) @ other.neutral
        assert white / white[1] == pytest.approx(D50, abs=1e-3)


def test_an_estimate_is_marked_and_older_calibrations_keep_their_ids() -> None:
    marked = balanced(CAMERA, np.array(LIGHT), estimated=True)
    assert SensorCalibration.from_json(marked.to_json()) == marked
    assert marked.without_estimates() == CAMERA
    assert marked.id != balanced(CAMERA, np.array(LIGHT)).id
    assert "neutral_estimated" not in CAMERA.to_json()
