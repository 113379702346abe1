"""Colour: white stays white, and the matrix gives back the colours of the scene."""

from typing import Any

import numpy as np
import pytest

from panchroma.shared.calibration import SensorCalibration
from panchroma.shared.colorimetry import as_rows
from panchroma.shared.errors import InputError
from panchroma.tools.io.colour import encode_srgb
from panchroma.tools.io.display import SPACES, ColourTransform
from tests.tools.io.examples import FOUR

ROUNDING = 1e-6
"""Of a float32 in 0..1 through a 3 x 3 matrix and the curve."""

# A real camera's figures (DNG ColorMatrix of a consumer model, inverted and adapted): positive
# diagonal, negative rest.
MATRIX = ((0.75, 0.15, 0.06), (0.28, 0.85, -0.13), (0.02, -0.12, 0.92))
NEUTRAL = (0.48, 1.0, 0.65)
# White reads NEUTRAL; the matrix is for balanced channels, nearly right only, as fits are.
TO_XYZ = as_rows(np.array(MATRIX) / NEUTRAL)
CAMERA = SensorCalibration(neutral=NEUTRAL, camera_to_xyz=TO_XYZ)


# --- white ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize(
    "calibration", [SensorCalibration(), SensorCalibration(neutral=NEUTRAL), CAMERA, FOUR]
)
def test_neutral_readings_become_grey_and_keep_their_level(
    calibration: SensorCalibration, name: str
) -> None:
    neutral = np.array(calibration.neutral or (1.0, 1.0, 1.0), np.float32)
    levels = np.linspace(0, 1, 33, dtype=np.float32)
    greys = levels[:, None] * neutral / neutral.max()
    result = ColourTransform.to_space(calibration, name).apply(greys[None])
    expected = levels if SPACES[name].linear else encode_srgb(levels)
    np.testing.assert_allclose(result[0], np.repeat(expected[:, None], 3, axis=1), atol=ROUNDING)


def test_clipped_highlights_are_white_and_not_magenta() -> None:
    clipped = np.array([[(1, 1, 1), (0.7, 1.5, 0.9), (1e30, 1e30, 3e38)]], np.float32)
    shown = ColourTransform.to_space(CAMERA).apply(clipped)
    np.testing.assert_allclose(shown, 1.0, atol=ROUNDING)


def test_noise_below_black_does_not_lift_the_other_channels_shadows() -> None:
    transform = ColourTransform.to_space(CAMERA, "linear-srgb")
    noise = np.random.default_rng(1).normal(0.0, 0.01, (200, 200, 3)).astype(np.float32)
    assert abs(transform.apply(noise).mean(axis=(0, 1))).max() < 5e-4


# --- colour --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPACES)
def test_a_perfect_matrix_gives_back_the_colours_of_the_scene(name: str) -> None:
    """A sensor whose filters are known mixtures of Display P3: what it sees of RGB is undone
    exactly.
    """
    mixing = np.array([[0.40, 0.06, 0.02], [0.15, 0.80, 0.05], [0.03, 0.12, 0.50]])
    camera_to_xyz = SPACES["display-p3"].to_xyz @ np.linalg.inv(mixing)
    white = mixing.sum(axis=1)
    sensor = SensorCalibration(neutral=tuple(white), camera_to_xyz=as_rows(camera_to_xyz))
    scene = np.random.default_rng(2).uniform(0, 0.5, (8, 9, 3))
    linear = scene @ (np.linalg.inv(SPACES[name].to_xyz) @ SPACES["display-p3"].to_xyz).T
    expected = linear if SPACES[name].linear else encode_srgb(linear.astype(np.float32))
    measured = (scene @ mixing.T / white.max()).astype(np.float32)
    result = ColourTransform.to_space(sensor, name).apply(measured)
    # the curve is 12.92 times as steep near black
    np.testing.assert_allclose(result, expected, atol=1e-5)


@pytest.mark.parametrize("restored", [True, False])
@pytest.mark.parametrize("stops", [-16.0, -4.0, -1.0, 0.0, 1.0, 16.0])
@pytest.mark.parametrize("calibration", [SensorCalibration(), CAMERA, FOUR])
def test_what_is_burnt_out_is_white_at_every_exposure(
    calibration: SensorCalibration, stops: float, restored: bool
) -> None:
    """White that is brighter and brighter: no step down, no tint, white at the end; and what is
    dark follows the exposure.
    """
    shown = ColourTransform.to_space(calibration, restored=restored)
    white, limit = np.array(shown.white), calibration.full_scale
    end = limit / white.min() if restored else limit / (white @ calibration.gamma)
    ramp = (np.linspace(0, end, 400)[:, None] * white).astype(np.float32)[None]
    result = shown.apply(ramp, stops)[0]
    assert np.ptp(result, axis=1).max() < 1e-4
    assert np.diff(result[:, 1]).min() > -ROUNDING
    np.testing.assert_allclose(result[-1], 1, atol=ROUNDING)
    below = ramp[0, :, 1] < 0.6 * ramp[0, -1, 1]
    linear = (ramp[0, below, 1] / np.float32(white[1]) * 2**stops).clip(0, 1)
    np.testing.assert_allclose(result[below, 1], encode_srgb(linear.astype(np.float32)), atol=1e-4)
    if stops <= -1:
        assert np.diff(result[:, 1]).max() < 0.2  # no hard edge


@pytest.mark.parametrize(
    ("calibration", "message"),
    [
        ({"channels": "RGE"}, "no colour matrix for the channels RGE: calibrate"),
        ({"camera_to_xyz": ((-1, 0, 0), (0, -1, 0), (0, 0, -1))}, "no colour of light"),
        ({"camera_to_xyz": ((1, 0, 0), (0, 1, 0), (0, 0, -1))}, "no colour of light"),
    ],
)
def test_what_has_no_colour_is_refused(calibration: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ColourTransform.to_space(SensorCalibration(**calibration))
