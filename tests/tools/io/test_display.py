"""Colour: white stays white, the matrix gives back the colours of the scene, the curve is the standard's."""

import numpy as np
import pytest

from shared.arrays import STRIP, FloatArray
from shared.calibration import SensorCalibration
from shared.colorimetry import D50
from shared.errors import InputError
from tools.io.colour import decode_srgb, encode_srgb
from tools.io.display import MAX_EXPOSURE, SPACES, ColourTransform, checked_picture

ROUNDING = 1e-6
"""Of a float32 in 0..1 through a 3 x 3 matrix and the curve."""

# A real camera's figures (DNG ColorMatrix of a consumer model, inverted and adapted): positive diagonal, negative rest.
MATRIX = ((0.75, 0.15, 0.06), (0.28, 0.85, -0.13), (0.02, -0.12, 0.92))
NEUTRAL = (0.48, 1.0, 0.65)
# White reads NEUTRAL; the matrix is for balanced channels, nearly right only, as fits are.
CAMERA = SensorCalibration(
    neutral=NEUTRAL, camera_to_xyz=tuple(tuple(value / n for value, n in zip(row, NEUTRAL, strict=True)) for row in MATRIX)
)
FOUR = SensorCalibration(
    channels="RGBE",
    neutral=(0.5, 1.0, 0.6, 0.9),
    camera_to_xyz=((0.9, 0.2, 0.1, 0.1), (0.4, 0.6, -0.1, 0.1), (0.0, -0.1, 1.0, 0.2)),
)


def picture(*pixels: tuple[float, ...]) -> FloatArray:
    return np.array([pixels], np.float32)


def random_picture(shape: tuple[int, ...], seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).random(shape, np.float32)


# --- spaces -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "published"),
    [
        # sRGB Profile of the ICC; Display P3 of macOS. They round D65 and D50 differently in the fourth decimal.
        ("srgb", [[0.43607, 0.38515, 0.14307], [0.22249, 0.71687, 0.06061], [0.01392, 0.09708, 0.71410]]),
        ("display-p3", [[0.51512, 0.29198, 0.15710], [0.24120, 0.69225, 0.06657], [-0.00105, 0.04189, 0.78407]]),
    ],
)
def test_primaries_are_those_of_the_published_profiles(name: str, published: list[list[float]]) -> None:
    np.testing.assert_allclose(SPACES[name].to_xyz, published, atol=2e-4)


# --- white ------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("calibration", [SensorCalibration(), SensorCalibration(neutral=NEUTRAL), CAMERA, FOUR])
def test_neutral_readings_become_grey_and_keep_their_level(calibration: SensorCalibration, name: str) -> None:
    neutral = np.array(calibration.neutral or (1.0, 1.0, 1.0), np.float32)
    levels = np.linspace(0, 1, 33, dtype=np.float32)
    result = ColourTransform.to_space(calibration, name).apply((levels[:, None] * neutral / neutral.max())[None])
    expected = levels if SPACES[name].linear else encode_srgb(levels)
    np.testing.assert_allclose(result[0], np.repeat(expected[:, None], 3, axis=1), atol=ROUNDING)


def test_scale_of_the_neutral_and_of_the_matrix_mean_nothing() -> None:
    scaled = SensorCalibration(
        neutral=tuple(7 * value for value in NEUTRAL),
        camera_to_xyz=tuple(tuple(3 * value for value in row) for row in CAMERA.camera_to_xyz or ()),
    )
    plain, other = (ColourTransform.to_space(calibration) for calibration in (CAMERA, scaled))
    np.testing.assert_allclose(other.matrix, plain.matrix, rtol=1e-12, atol=1e-15)
    assert other.white == pytest.approx(plain.white, rel=1e-12)


def test_clipped_highlights_are_white_and_not_magenta() -> None:
    shown = ColourTransform.to_space(CAMERA).apply(picture((1, 1, 1), (0.7, 1.5, 0.9), (1e30, 1e30, 3e38)))
    np.testing.assert_allclose(shown, 1.0, atol=ROUNDING)


def test_linear_keeps_what_is_past_white_and_below_black() -> None:
    transform = ColourTransform.to_space(SensorCalibration(), "linear-srgb")
    pixels = picture((4.0, 2.5, 1.5), (-0.25, 0.5, -0.125))
    np.testing.assert_allclose(transform.apply(pixels), pixels, rtol=ROUNDING, atol=ROUNDING)


def test_noise_below_black_does_not_lift_the_other_channels_shadows() -> None:
    transform = ColourTransform.to_space(CAMERA, "linear-srgb")
    noise = np.random.default_rng(1).normal(0.0, 0.01, (200, 200, 3)).astype(np.float32)
    assert abs(transform.apply(noise).mean(axis=(0, 1))).max() < 5e-4


# --- colour -----------------------------------------------------------------------------------------------------------------------


def test_missing_neutral_is_the_one_of_the_matrix() -> None:
    white = np.array(ColourTransform.to_space(SensorCalibration(camera_to_xyz=CAMERA.camera_to_xyz)).white)
    np.testing.assert_allclose(np.array(CAMERA.camera_to_xyz) @ white / D50, (np.array(CAMERA.camera_to_xyz) @ white)[1], rtol=1e-9)
    assert white.max() == 1.0


def test_an_uncalibrated_sensor_has_the_primaries_of_srgb() -> None:
    rgb = random_picture((20, 30, 3))
    np.testing.assert_allclose(ColourTransform.to_space(SensorCalibration()).apply(rgb), encode_srgb(rgb), atol=ROUNDING)


@pytest.mark.parametrize("name", SPACES)
def test_a_perfect_matrix_gives_back_the_colours_of_the_scene(name: str) -> None:
    """A sensor whose filters are known mixtures of Display P3: what it sees of RGB is undone exactly."""
    mixing = np.array([[0.40, 0.06, 0.02], [0.15, 0.80, 0.05], [0.03, 0.12, 0.50]])
    camera_to_xyz = SPACES["display-p3"].to_xyz @ np.linalg.inv(mixing)
    white = mixing.sum(axis=1)
    calibration = SensorCalibration(neutral=tuple(white), camera_to_xyz=tuple(map(tuple, camera_to_xyz)))
    scene = random_picture((8, 9, 3), seed=2) * 0.5
    linear = scene @ (np.linalg.inv(SPACES[name].to_xyz) @ SPACES["display-p3"].to_xyz).T
    expected = linear if SPACES[name].linear else encode_srgb(linear.astype(np.float32))
    result = ColourTransform.to_space(calibration, name).apply((scene @ mixing.T / white.max()).astype(np.float32))
    np.testing.assert_allclose(result, expected, atol=1e-5)  # the curve is 12.92 times as steep near black


def test_exposure_is_in_stops() -> None:
    transform = ColourTransform.to_space(CAMERA, "linear-srgb")
    rgb = random_picture((4, 4, 3))
    np.testing.assert_allclose(transform.apply(rgb, 1.5), 2**1.5 * transform.apply(rgb), rtol=1e-5)
    shown = ColourTransform.to_space(CAMERA)
    whites = np.array(NEUTRAL) * np.array([[0.5], [1], [2], [4]])
    darker = shown.apply(whites[None].astype(np.float32), -1.0)
    np.testing.assert_allclose(darker[0, :, 1], encode_srgb(np.array([0.25, 0.5, 1, 1], np.float32)), atol=ROUNDING)
    assert np.ptp(darker, axis=2).max() < ROUNDING
    assert shown.apply(rgb, MAX_EXPOSURE).max() <= 1.0


@pytest.mark.parametrize("restored", [True, False])
@pytest.mark.parametrize("stops", [-16.0, -4.0, -1.0, 0.0, 1.0, 16.0])
@pytest.mark.parametrize("calibration", [SensorCalibration(), CAMERA, FOUR])
def test_what_is_burnt_out_is_white_at_every_exposure(calibration: SensorCalibration, stops: float, restored: bool) -> None:
    """White that is brighter and brighter: no step down, no tint, white at the end; and what is dark follows the exposure."""
    shown = ColourTransform.to_space(calibration, restored=restored)
    white, limit = np.array(shown.white), calibration.full_scale
    end = limit / white.min() if restored else limit / (white @ calibration.gamma)
    ramp = (np.linspace(0, end, 400)[:, None] * white).astype(np.float32)[None]
    seen = shown.apply(ramp, stops)[0]
    assert np.ptp(seen, axis=1).max() < 1e-4
    assert np.diff(seen[:, 1]).min() > -ROUNDING
    np.testing.assert_allclose(seen[-1], 1, atol=ROUNDING)
    below = ramp[0, :, 1] < 0.6 * ramp[0, -1, 1]
    expected = encode_srgb((ramp[0, below, 1] / np.float32(white[1]) * 2**stops).clip(0, 1).astype(np.float32))
    np.testing.assert_allclose(seen[below, 1], expected, atol=1e-4)
    if stops <= -1:
        assert np.diff(seen[:, 1]).max() < 0.2  # no hard edge


@pytest.mark.parametrize("colour", [(0.3, 1.8, 0.9), (1.8, 1.6, -0.4)])
def test_where_nothing_is_restored_saturated_pixels_lose_their_wrong_colour(colour: tuple[float, ...]) -> None:
    """The paper's method takes a colour from samples that are clipped: yellow, for a white sky or an orange lamp."""
    sky = picture(colour) * np.float32(CAMERA.full_scale / 3)
    kept, white = (ColourTransform.to_space(CAMERA, restored=restored).apply(sky) for restored in (True, False))
    assert np.ptp(kept) > 0.1
    np.testing.assert_allclose(white, 1, atol=ROUNDING)
    linear = ColourTransform.to_space(CAMERA, "linear-srgb", restored=False)
    np.testing.assert_array_equal(linear.apply(sky), ColourTransform.to_space(CAMERA, "linear-srgb").apply(sky))


def test_strips_leave_no_seam() -> None:
    transform = ColourTransform.to_space(CAMERA)
    rgb = random_picture((2 * STRIP + 1, 3, 3))
    whole = transform.apply(rgb)
    single = np.concatenate([transform.apply(row[None]) for row in rgb])
    assert whole.tobytes() == single.tobytes()


@pytest.mark.parametrize(
    ("calibration", "space", "message"),
    [
        (SensorCalibration(), "cmyk", "unknown output space 'cmyk'"),
        (SensorCalibration(channels="RGE"), "srgb", "no colour matrix for the channels RGE: calibrate"),
        (SensorCalibration(camera_to_xyz=((-1, 0, 0), (0, -1, 0), (0, 0, -1)), neutral=(1, 1, 1)), "srgb", "no colour of light"),
        (SensorCalibration(camera_to_xyz=((1, 0, 0), (0, 1, 0), (0, 0, -1))), "srgb", "no colour of light"),
    ],
)
def test_what_has_no_colour_is_refused(calibration: SensorCalibration, space: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ColourTransform.to_space(calibration, space)


@pytest.mark.parametrize("neutral", [None, (0.5, 3.0, 1.0, 0.7)])
def test_channels_beside_red_green_and_blue_do_not_count(neutral: tuple[float, ...] | None) -> None:
    """Nobody knows what colour they are; the others have that of any camera."""
    picture = random_picture((5, 6, 4))
    of_rgb = [0, 2, 3]
    known = SensorCalibration(neutral=None if neutral is None else tuple(neutral[channel] for channel in of_rgb))
    expected = ColourTransform.to_space(known).apply(picture[..., of_rgb])
    found = ColourTransform.to_space(SensorCalibration("RNGB", neutral=neutral)).apply(picture)
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("exposure", [17.0, float("nan"), float("-inf")])
def test_an_impossible_exposure_is_refused(exposure: float) -> None:
    with pytest.raises(InputError, match="stops"):
        ColourTransform.to_space(CAMERA).apply(picture((1, 1, 1)), exposure)


@pytest.mark.parametrize(
    ("rgb", "message"),
    [
        (np.zeros((4, 4, 4), np.float32), "expected \\(rows, columns, 3\\)"),
        (np.zeros((0, 4, 3), np.float32), "expected \\(rows, columns, 3\\)"),
        (np.zeros((4, 4, 3), np.uint8), "uint8, expected floating-point"),
        (np.full((4, 4, 3), np.nan, np.float32), "48 of 48 values"),
    ],
)
def test_what_is_no_picture_is_refused(rgb: FloatArray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        checked_picture(rgb, 3)


# --- curve ------------------------------------------------------------------------------------------------------------------------


def test_curve_is_that_of_the_standard() -> None:
    linear = np.linspace(0, 1, 4097)
    exact = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    encoded = encode_srgb(linear.astype(np.float32))
    np.testing.assert_allclose(encoded, exact, atol=ROUNDING)
    np.testing.assert_allclose(decode_srgb(exact), linear, atol=ROUNDING)
    assert (np.diff(encoded) > 0).all()
