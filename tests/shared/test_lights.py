"""Colours between two lights, against DNG 1.7.1, chapter 6, word for word."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.device.capture.loop import SteadyWhite
from panchroma.shared import Camera, CfaPattern, DoubleArray, InputError, Mosaic, SensorCalibration
from panchroma.shared.colorimetry import D50, adaptation, as_rows, xyz
from panchroma.shared.lights import (
    CalibratedLight,
    Lights,
    colours_under,
    illuminant_xy,
    temperature,
)
from panchroma.shared.white_balance import balanced

# Matrices of a camera for A and D65, and what white reads in a shot: the example of
# `camera_neutral_to_xy` in colour-hdri 0.2.6.
WARM = np.array([[0.5309, -0.0229, -0.0336], [-0.6241, 1.3265, 0.3337], [-0.0817, 0.1215, 0.6664]])
COLD = np.array([[0.4716, 0.0603, -0.0830], [-0.7798, 1.5474, 0.2480], [-0.1496, 0.1937, 0.6651]])
SHOT = (0.413070, 1.0, 0.646465)
# of a matrix's largest figure: temperatures by Robertson's table and by McCamy's formula differ by
# up to 0.2 %
ROBERTSON = 2e-3


def light(illuminant: str, to_camera: DoubleArray) -> CalibratedLight:
    """The light whose ColorMatrix is `to_camera`."""
    white = xyz(*illuminant_xy(illuminant))
    neutral = to_camera @ white
    matrix = adaptation(white) @ np.linalg.pinv(to_camera) * neutral.max()
    return CalibratedLight(illuminant, as_rows(matrix), tuple((neutral / neutral.max()).tolist()))


LIGHTS: Lights = (light("A", WARM), light("D65", COLD))
CAMERA = SensorCalibration.of_bits(12, lights=LIGHTS)
PATTERN = CfaPattern.bayer(6)


# Chromaticities by colour-science 0.4.7: of black bodies, and from 5000 kelvin of the CIE's
# daylight.
PUBLISHED = {
    2000: (0.5267, 0.4133), 2500: (0.4770, 0.4137), 3000: (0.4369, 0.4041), 3500: (0.4053, 0.3907), 4000: (0.3804, 0.3767),
    4500: (0.3608, 0.3635), 5000: (0.3457, 0.3587), 5500: (0.3325, 0.3476), 6000: (0.3217, 0.3378), 6500: (0.3128, 0.3292),
    7000: (0.3054, 0.3216), 7500: (0.2991, 0.3150), 8000: (0.2938, 0.3092), 9000: (0.2853, 0.2996), 10000: (0.2788, 0.2920),
}  # fmt: skip
# Matrices to XYZ (D50) by the iteration of the specification, with Robertson's temperatures
# (colour-science 0.4.7); largest 1.
WARMER = (0.9, 1.0, 0.35)
BETWEEN: dict[tuple[float, ...], list[list[float]]] = {
    SHOT: [[1.0, -0.04259, 0.11427], [0.48526, 0.30432, -0.06793], [0.06469, -0.08211, 0.67374]],
    WARMER: [[0.35806, -0.03264, 0.14389], [0.16931, 0.22329, -0.06595], [0.05322, -0.10704, 1.0]],
}


def test_illuminants_are_those_of_the_cie() -> None:
    for kelvin, published in PUBLISHED.items():
        found = illuminant_xy(str(kelvin))
        assert found == pytest.approx(published, abs=4e-4)  # Krystek's error
        assert temperature(found) == pytest.approx(kelvin, rel=0.013)
    assert temperature((0.7, 0.29)) == pytest.approx(1620, abs=10)  # red
    assert temperature((0.2, 0.1)) > 20000  # blue


@pytest.mark.parametrize(
    "name", ["B", "", "nan", "-4000", "1999", "10001", "4_000", 4000, ["A"], None]
)
def test_other_lights_are_refused(name: Any) -> None:
    with pytest.raises(InputError, match="expected A, D50, D55, D65, D75, or 2000 to 10000 kelvin"):
        illuminant_xy(name)


@pytest.mark.parametrize("neutral", BETWEEN)
def test_a_light_between_is_what_the_specification_says(neutral: tuple[float, ...]) -> None:
    found = np.array(colours_under(LIGHTS, neutral))
    np.testing.assert_allclose(found / found.max(), BETWEEN[neutral], atol=ROBERTSON)


@pytest.mark.parametrize("planes", [3, 4])
def test_under_either_light_it_is_its_matrix_and_white_is_always_white(planes: int) -> None:
    mixed = np.vstack([np.eye(3), [[0.4, 0.5, 0.1]]])[:planes]
    lights: Lights = (light("3000", mixed @ WARM), light("6500", mixed @ COLD))
    for known in lights:
        matrix = np.array(colours_under(lights, known.neutral))
        np.testing.assert_allclose(matrix, known.camera_to_xyz, atol=1e-6)
    # Most of these are no colour of light.
    for neutral in 10.0 ** np.random.default_rng(0).uniform(-3, 3, (50, planes)):
        matrix = np.array(colours_under(lights, tuple(neutral)))
        np.testing.assert_allclose(matrix @ neutral / neutral.max(), D50, rtol=1e-6)
    unknown = np.array(colours_under(lights, None))
    np.testing.assert_allclose(unknown @ (mixed @ COLD @ D50), D50, rtol=0.3)


def test_where_no_light_looks_so_the_channels_of_the_nearest_are_scaled() -> None:
    for nearest in LIGHTS:
        leaves = np.array(nearest.neutral) * (1, 30, 1)
        matrix = np.array(colours_under(LIGHTS, tuple(leaves)))
        expected = np.array(nearest.camera_to_xyz) * nearest.neutral / leaves
        np.testing.assert_allclose(matrix / matrix.max(), expected / expected.max(), rtol=1e-9)


def test_the_matrix_follows_the_neutral_wherever_that_is_changed() -> None:
    for neutral in (LIGHTS[0].neutral, SHOT):
        expected = colours_under(LIGHTS, neutral)
        assert replace(CAMERA, neutral=neutral).camera_to_xyz == expected
        scaled = balanced(CAMERA, 3 * np.array(neutral)).camera_to_xyz
        np.testing.assert_allclose(np.array(scaled), np.array(expected), rtol=1e-9)
    own = SensorCalibration.of_bits(12, neutral=SHOT, neutral_estimated=True)
    shot = Mosaic(np.full((12, 12), 900, np.uint16), PATTERN, own)
    known = Camera(CAMERA, PATTERN).calibrated(shot).calibration
    assert (known.neutral, known.neutral_estimated, known.lights) == (SHOT, True, LIGHTS)
    assert known.camera_to_xyz == colours_under(LIGHTS, SHOT)


def test_where_nobody_has_measured_the_light_it_is_estimated() -> None:
    """In the frames of a stream, and in shots that say nothing, or what pictures say."""
    grey = np.random.default_rng(1).uniform(0.1, 0.9, (40, 40)).repeat(6, 0).repeat(6, 1)
    reads = np.array([0.5, 1.0, 0.6, 2.1], np.float32)  # the channels, and their sum
    samples = grey.astype(np.float32) * reads[PATTERN.filter_map(grey.shape)]
    stated = [SensorCalibration.of_bits(12, neutral=neutral) for neutral in (None, (1.0, 1.0, 1.0))]
    shots = [Mosaic(samples, PATTERN, calibration) for calibration in stated]
    taken = [Camera(CAMERA, PATTERN).calibrated(shot) for shot in shots]
    taken.append(SteadyWhite()(Mosaic(samples, PATTERN, CAMERA)))
    for found in (each.calibration for each in taken):
        assert found.neutral == pytest.approx((0.5, 1.0, 0.6), abs=1e-3)
        assert found.neutral_estimated
        assert found.camera_to_xyz == colours_under(LIGHTS, found.neutral)
    dark = replace(shots[0], samples=np.zeros((240, 240), np.float32))
    assert Camera(CAMERA, PATTERN).calibrated(dark).calibration.neutral is None


def test_json_and_back() -> None:
    document = replace(CAMERA, neutral=SHOT).to_json()
    assert "camera_to_xyz" not in document
    assert SensorCalibration.from_json(document) == replace(CAMERA, neutral=SHOT)
    assert replace(CAMERA, lights=LIGHTS[::-1]) == CAMERA


def test_gamma_of_two_lights_is_mixed_for_the_neutral_and_beyond_them_the_nearer_holds() -> None:
    gammas = (0.8, 1.1, 1.0), (1.0, 1.1, 0.9)
    warm, cold = (replace(each, gamma=gamma) for each, gamma in zip(LIGHTS, gammas, strict=True))
    known = SensorCalibration.of_bits(12, gamma=(3.0, 3.0, 3.0), lights=(warm, cold))

    def under(neutral: Any) -> DoubleArray:
        return np.array(replace(known, neutral=tuple(neutral)).gamma)

    np.testing.assert_allclose(under(3 * np.array(warm.neutral)), gammas[0])
    np.testing.assert_allclose(under(cold.neutral), gammas[1])
    between = np.sqrt(np.multiply(warm.neutral, cold.neutral))
    np.testing.assert_allclose(under(between), (0.9, 1.1, 0.95))
    np.testing.assert_allclose(under((0.1, 1.0, 1.0)), gammas[1])
    assert 0.81 < known.gamma[0] < 0.99  # of D50, where no white is known
    shot = balanced(known, np.array(SHOT))
    assert SensorCalibration.from_json(shot.to_json()) == shot != known
    # A camera file without colours keeps its own gamma, whatever the lights of the shot say.
    own = Camera(SensorCalibration.of_bits(12, gamma=(0.7, 0.8, 0.9)))
    taken = Mosaic(np.zeros((12, 12), np.uint16), PATTERN, shot)
    assert own.calibrated(taken).calibration.gamma == (0.7, 0.8, 0.9)
    assert "gamma" not in CAMERA.to_json()["lights"][0]
