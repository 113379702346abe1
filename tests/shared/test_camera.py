"""Calibrations; shading as a value, in shots and camera files, and in what a sensor sees."""

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline

from panchroma.shared import Camera, CfaPattern, Mosaic, NoiseModel, SensorCalibration, read_camera
from panchroma.shared.arrays import FloatArray
from panchroma.shared.calibration import BITS
from panchroma.shared.errors import InputError
from panchroma.shared.shading import basis
from panchroma.shared.white_balance import estimate_neutral
from panchroma.tools.simulation.sensor import sample, simulate_additive, simulate_sensor
from tests.scenes import darker_corners
from tests.shared.dng.examples import calibration
from tests.walking import one_field_changed

# --- calibration ---------------------------------------------------------------------------------

FULL = calibration()


@pytest.mark.parametrize("bits", BITS)
def test_levels_of_bits_leave_room_at_both_ends(bits: int) -> None:
    roomy = SensorCalibration.of_bits(bits)
    clipping = SensorCalibration.of_bits(bits, headroom=False)
    black, highest = 2**bits // 16, 2**bits - 1
    assert roomy.black_level == clipping.black_level == (black,) * 4
    assert (roomy.white_level, clipping.white_level) == (highest - black, highest)
    assert roomy.bits == clipping.bits == bits


def test_noise_is_poisson_plus_gaussian_per_plane() -> None:
    noise = NoiseModel((0.0, 0.04), (0.3, 0.1))
    assert noise.sigma(5.0, plane=0) == pytest.approx(0.3)
    assert noise.sigma(2.0) == noise.sigma(2.0, plane=1) == pytest.approx(math.sqrt(0.08 + 0.01))
    assert noise.sigma(-1.0) == pytest.approx(0.1)  # a sample below black has no shot noise
    assert NoiseModel.gaussian(0.02, 4) == NoiseModel((0.0,) * 4, (0.02,) * 4)


def test_values_of_any_type_are_taken_as_what_they_hold() -> None:
    fields: dict[str, Any] = {
        "gamma": np.array([1, 2, 3]),
        "black_level": np.array([60, 61, 62, 63]),
        "white_level": np.uint16(4000),
        "neutral": np.array([0.5, 1.0, 0.75], np.float32),
        "camera_to_xyz": np.eye(3),
    }
    ours = SensorCalibration(**fields)
    plain = SensorCalibration(**{name: value.tolist() for name, value in fields.items()})
    assert (ours, ours.id, ours.bits) == (plain, plain.id, 12)
    assert SensorCalibration(defects=((5, 1), (2, 3), (5, 1))).defects == ((2, 3), (5, 1))


def test_id_depends_on_every_field_but_the_camera() -> None:
    plain = replace(FULL)  # without a cached id
    ids = {name: other.id for name, other in one_field_changed(plain) if name != "lights"}
    assert ids.pop("camera") == plain.id
    assert len({plain.id, *ids.values()}) == len(ids) + 1
    # as before a calibration had parts of the lens
    assert SensorCalibration().id == "cf85a866dfbe7789"


# --- camera ---------------------------------------------------------------------------------------

CALIBRATION = replace(FULL, camera_to_xyz=None, neutral=None, defects=((1, 2),))
CAMERA = Camera(CALIBRATION, CfaPattern.bayer(6), {"gamma": {"shots": ["a.dng"]}})


def test_json_and_back_is_the_identity(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(CAMERA.to_json()))
    assert read_camera(path) == CAMERA
    assert CAMERA.calibration.camera == CALIBRATION.id
    assert replace(CAMERA.calibration, noise=None).camera == CALIBRATION.id


def test_channels_that_only_one_part_names_are_those_of_both() -> None:
    stated = {"schema": 1, "gamma": [1, 2], "channels": "RB"}
    of_calibration = stated | {"pattern": {"tile": ("RWRW", "WBWB") * 2}}
    of_pattern = {"schema": 1, "gamma": [1, 2], "pattern": {"tile": ("WWWW", "WRWR") * 2}}
    for document, expected in ((of_calibration, "RB"), (of_pattern, "RC")):
        camera = Camera.from_json(document)
        assert camera.calibration.channels == camera.pattern.channels == expected


def test_a_calibrated_shot_keeps_what_the_camera_does_not_know() -> None:
    plain = SensorCalibration.of_bits(12, neutral=(0.5, 1.0, 0.7), defects=((3, 4),))
    shot = Mosaic(np.full((24, 24), 500, np.uint16), CfaPattern.bayer(6), plain)
    expected = replace(CAMERA.calibration, neutral=(0.5, 1.0, 0.7))
    assert CAMERA.calibrated(shot).calibration == expected
    coloured = replace(CALIBRATION, neutral=(0.6, 1.0, 0.6), defects=())
    for measured, defects in ({}, ((3, 4),)), ({"defects": {"frames": 10}}, ()):
        known = Camera(coloured, CAMERA.pattern, measured).calibrated(shot).calibration
        assert (known.neutral, known.defects) == ((0.6, 1.0, 0.6), defects)


# --- lens -----------------------------------------------------------------------------------------

SHAPE = (61, 90)
PATTERN = CfaPattern.bayer(6, origin=(4, 1))
BARE = SensorCalibration.of_bits(16, gamma=(0.9, 1.1, 0.8))
DARKER = darker_corners(SHAPE)
SHADED = replace(BARE, shading=DARKER)


def scene() -> FloatArray:
    return np.random.default_rng(1).uniform(0.1, 1, (*SHAPE, 3)).astype(np.float32)


def shot_by(calibration: SensorCalibration) -> Mosaic:
    return simulate_sensor(scene(), PATTERN, calibration, 1.0, np.random.default_rng(0))


def test_a_camera_file_keeps_it_and_a_shot_has_that_of_the_camera_or_its_own() -> None:
    taken, camera = shot_by(SHADED), Camera.from_json(Camera(SHADED).to_json())
    stated = camera.calibrated(replace(taken, calibration=BARE)), Camera(BARE).calibrated(taken)
    for each in (camera, *stated):
        assert each.calibration.shading == DARKER


def test_shading_of_frames_of_another_size_is_refused() -> None:
    taken = shot_by(BARE)
    with pytest.raises(InputError, match="the frames have 90 x 61 pixels"):
        Camera(SHADED, size=(30, 45)).calibrated(taken)


def test_frames_have_the_size_it_was_measured_on_or_are_made_smaller() -> None:
    shading = replace(DARKER, size=(600, 900))
    for shape in ((600, 900), (300, 450), (1200, 1800), (200, 299)):
        shading.check(shape)
    for shape in ((600, 896), (597, 900)):
        with pytest.raises(InputError, match="measured on frames of 900 x 600 pixels, and the"):
            shading.check(shape)
    with pytest.raises(InputError, match="frames of 90 x 61 pixels, and the frame has 90 x 90"):
        Mosaic(np.zeros((90, 90), np.float32), PATTERN, SHADED)


def test_a_shot_at_another_focal_length_is_remarked_on() -> None:
    zoom = replace(DARKER, focal_length=35)
    assert zoom.zoomed(36).startswith("taken at 36 mm")
    assert zoom.zoomed(35.5) == zoom.zoomed(None) == ""


def test_a_part_has_the_gain_of_the_whole() -> None:
    whole = DARKER.of_plane(SHAPE, 0)
    for window in (np.s_[4:5, :], np.s_[3::6, 2::6], np.s_[0:61, 89:90]):
        assert np.array_equal(DARKER.of_plane(SHAPE, 0, *window), whole[window])
    assert whole[30, 45] == pytest.approx(1, abs=1e-3)


def test_control_points_are_those_of_a_cubic_spline() -> None:
    points, place = np.random.default_rng(0).uniform(1, 2, 9), np.arange(100.0)
    spline = BSpline(np.arange(-3, 10) / 6, points, 3)((place + 0.5) / 100)
    np.testing.assert_allclose(basis(100, 9, place) @ points, spline, rtol=1e-12)


def test_what_the_sensor_reads_is_less_and_scene_units_are_not() -> None:
    shaded, even = sample(scene(), PATTERN, SHADED), sample(scene(), PATTERN, BARE)
    gains = np.stack([DARKER.of_plane(SHAPE, plane) for plane in range(4)])
    gain = np.take_along_axis(gains, PATTERN.filter_map(SHAPE)[None].astype(int), 0)[0]
    np.testing.assert_allclose(even / shaded, gain, rtol=1e-5)
    shot = simulate_additive(scene(), PATTERN, SHADED, 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(shot.signal, even, rtol=1e-5)
    of_codes = Mosaic(shot.codes, PATTERN, SHADED)
    np.testing.assert_allclose(of_codes.signal, even, atol=2e-4)
    assert np.array_equal(of_codes.in_scene_units().codes, of_codes.codes)


def test_evenly_shaded_frames_keep_what_panchromatic_pixels_read() -> None:
    shot = shot_by(SHADED)
    dim, clear = shot.evenly_shaded(), PATTERN.panchromatic_mask(SHAPE)
    assert dim.calibration.shading is None
    assert np.array_equal(dim.signal[clear], Mosaic(shot.codes, PATTERN, BARE).signal[clear])
    close = partial(np.testing.assert_allclose, rtol=1e-5, atol=1e-6)
    close(dim.signal * DARKER.of_plane(SHAPE), shot.signal)
    close(shot.in_scene_units().evenly_shaded().signal, dim.signal)


def test_the_neutral_is_estimated_without_it() -> None:
    grey = np.full((120, 180, 3), (0.4, 0.6, 0.5), np.float32)
    lens = replace(BARE, shading=darker_corners((120, 180), colour=0.3))
    shot = simulate_sensor(grey, PATTERN, lens, 1.0, np.random.default_rng(0))
    assert estimate_neutral(shot) == pytest.approx((0.4 / 0.6, 1, 0.5 / 0.6), rel=0.02)
