"""Shading as a value, in calibrations and files, and in a mosaic's samples."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared import CfaPattern, Mosaic, SensorCalibration, Shading
from shared.errors import InputError
from shared.sensor import sample, simulate_additive, simulate_sensor
from shared.shading import basis
from shared.white_balance import estimate_neutral
from tests.scenes import darker_corners

SHAPE = (61, 90)
LENS = darker_corners(SHAPE)
PATTERN = CfaPattern.bayer(6, origin=(4, 1))
CALIBRATION = SensorCalibration.of_bits(16, gamma=(0.9, 1.1, 0.8), shading=LENS)
BARE = replace(CALIBRATION, shading=None)
EVEN = [[[1.0] * 4] * 4] * 4


def scene() -> Any:
    return np.random.default_rng(1).uniform(0.1, 1, (*SHAPE, 3)).astype(np.float32)


def test_a_part_has_the_gain_of_the_whole() -> None:
    whole = LENS.of_plane(SHAPE, 0)
    for rows, columns in ((slice(4, 5), slice(None)), (slice(3, None, 6), slice(2, None, 6)), (slice(0, 61), slice(89, 90))):
        assert np.array_equal(LENS.of_plane(SHAPE, 0, rows, columns), whole[rows, columns])
    assert whole[30, 45] == pytest.approx(1, abs=1e-3)


def test_control_points_are_those_of_a_cubic_spline() -> None:
    from scipy.interpolate import BSpline

    points = np.random.default_rng(0).uniform(1, 2, 9)
    spline = BSpline(np.arange(-3, 10) / 6, points, 3)
    np.testing.assert_allclose(basis(100, 9, np.arange(100.0)) @ points, spline((np.arange(100) + 0.5) / 100), rtol=1e-12)


def test_what_the_sensor_reads_is_less_and_scene_units_are_not() -> None:
    shaded, even = sample(scene(), PATTERN, CALIBRATION), sample(scene(), PATTERN, BARE)
    planes = PATTERN.filter_map(SHAPE)
    for plane in range(4):
        here = planes == plane
        np.testing.assert_allclose((even / shaded)[here], LENS.of_plane(SHAPE, plane)[here], rtol=1e-5)
    shot = simulate_additive(scene(), PATTERN, CALIBRATION, 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(shot.signal, even, rtol=1e-5)
    of_codes = Mosaic(shot.codes, PATTERN, CALIBRATION)
    np.testing.assert_allclose(of_codes.signal, even, atol=2e-4)
    assert np.array_equal(of_codes.in_scene_units().codes, of_codes.codes)


def test_evenly_shaded_frames_keep_what_panchromatic_pixels_read() -> None:
    shot = simulate_sensor(scene(), PATTERN, CALIBRATION, 1.0, np.random.default_rng(0))
    dim, clear = shot.evenly_shaded(), PATTERN.panchromatic_mask(SHAPE)
    assert dim.calibration.shading is None
    assert np.array_equal(dim.signal[clear], Mosaic(shot.codes, PATTERN, BARE).signal[clear])
    np.testing.assert_allclose(dim.signal * LENS.of_plane(SHAPE), shot.signal, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(shot.in_scene_units().evenly_shaded().signal, dim.signal, rtol=1e-5, atol=1e-6)


def test_the_neutral_is_estimated_without_it() -> None:
    grey = np.full((120, 180, 3), (0.4, 0.6, 0.5), np.float32)
    lens = replace(BARE, shading=darker_corners((120, 180), colour=0.3))
    shot = simulate_sensor(grey, PATTERN, lens, 1.0, np.random.default_rng(0))
    assert estimate_neutral(shot) == pytest.approx((0.4 / 0.6, 1, 0.5 / 0.6), rel=0.02)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"gain": [[1.0] * 4] * 4}, "gain is 1.0, expected a list of numbers"),
        ({"gain": [[[1.0] * 3] * 4] * 4}, "4 to 32 rows and columns"),
        ({"gain": [[[1.0, 2.0], [1.0]]] * 4}, "gain is not"),
        ({"gain": [[[float("nan")] * 4] * 4] * 4}, "gain holds a figure"),
        ({"gain": [[[-1.0] * 4] * 4] * 4}, "the gains are -1 to -1"),
        ({"gain": [[[1.1] * 4] * 4] * 4}, "in the middle of the frame"),
        ({"residual": -1.0}, "residual is -1"),
    ],
)
def test_what_is_no_shading_is_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Shading(**{"gain": EVEN, "size": (60, 90), **changed})


def test_other_planes_are_refused() -> None:
    assert SensorCalibration().id == "cf85a866dfbe7789"  # as before there was shading
    with pytest.raises(InputError, match=r"shading has 3 planes, expected 4 \(RGBW\)"):
        SensorCalibration(shading=Shading(EVEN[:3], (60, 90)))  # type: ignore[arg-type]
