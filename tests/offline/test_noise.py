"""The noise of a mosaic, where nothing is known of it but the mosaic."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, clean_frame
from panchroma.offline.stages.chromaticity import sigma_z
from panchroma.offline.stages.noise import estimate_noise
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.sensor import sample
from tests.offline.scenes import CASES, shot

# Of the standard deviation: what 600 x 400 pixels tell.
ACCURACY = 0.12


def smooth(shape: tuple[int, int]) -> FloatArray:
    row, column = np.indices(shape)
    light = 0.05 + 0.9 * (row / shape[0] * 0.5 + 0.25 + 0.25 * np.sin(column / 40)) ** 2
    return (light[..., None] * np.array([0.9, 0.7, 0.5])).astype(np.float32)


def busy(shape: tuple[int, int]) -> FloatArray:
    """Two thirds of it under fine texture, much stronger than the noise."""
    texture = np.random.default_rng(0).uniform(0.7, 1.3, shape)
    texture[:, : shape[1] // 3] = 1
    return (smooth(shape) * texture[..., None]).astype(np.float32)


def busy_where_bright(shape: tuple[int, int]) -> FloatArray:
    """No smooth part is as bright as its texture, a third of all."""
    scene = smooth(shape)
    texture = np.random.default_rng(0).uniform(0.7, 1.3, shape)[..., None]
    return np.where(scene[..., :1] > 0.35, scene * texture, scene).astype(np.float32)


def noisy(rgb: FloatArray, pattern: CfaPattern, model: NoiseModel) -> Mosaic:
    calibration = SensorCalibration()
    clean = sample(rgb, pattern, calibration)
    deviation = np.sqrt(model.shot[-1] * clean + model.read[-1] ** 2)
    samples = clean + np.random.default_rng(1).normal(size=clean.shape) * deviation
    return Mosaic(samples.astype(np.float32), pattern, calibration)


@pytest.mark.parametrize("period", [3, 6, 8])
@pytest.mark.parametrize(("shot_noise", "read"), [(0.0, 0.02), (1e-3, 0.0), (5e-4, 0.01)])
@pytest.mark.parametrize("picture", [smooth, busy, busy_where_bright])
def test_estimates_are_near(
    picture: Callable[[tuple[int, int]], FloatArray], shot_noise: float, read: float, period: int
) -> None:
    true = NoiseModel((shot_noise,) * 4, (read,) * 4)
    found = estimate_noise(noisy(picture((400, 600)), CfaPattern.bayer(period), true))
    assert len(set(found.shot)) == len(set(found.read)) == 1
    for signal in (0.2, 0.5, 1.5):
        assert found.sigma(signal) == pytest.approx(true.sigma(signal), rel=ACCURACY)


def test_a_frame_too_small_to_tell_has_unknown_noise() -> None:
    for pattern, shape in CASES.values():
        assert estimate_noise(shot(pattern, shape)) is None


def test_clipped_parts_do_not_count() -> None:
    """There the noise is cut off, and would be the quietest of all."""
    rgb = smooth((400, 600))
    rgb[:, 300:] = 1
    mosaic = noisy(rgb, CfaPattern.bayer(6), NoiseModel.gaussian(0.02, 4))
    cut = Mosaic(np.minimum(mosaic.signal, 2.99), mosaic.pattern, mosaic.calibration)
    assert estimate_noise(cut).sigma(0.5) == pytest.approx(0.02, rel=ACCURACY)


def test_what_the_calibration_knows_is_not_estimated() -> None:
    mosaic = noisy(smooth((400, 600)), CfaPattern.bayer(6), NoiseModel.gaussian(0.02, 4))
    for settings, expected in ((PAPER, None), (BEST, estimate_noise(mosaic))):
        assert clean_frame(mosaic, settings).noise == expected
    model = NoiseModel.gaussian(0.5, 4)
    known = Mosaic(mosaic.signal, mosaic.pattern, replace(mosaic.calibration, noise=model))
    assert clean_frame(known, PAPER).noise == clean_frame(known, BEST).noise == model


@pytest.mark.parametrize("bits", [8, 12])
def test_rounding_to_codes_is_noise_too(bits: int) -> None:
    calibration, pattern = SensorCalibration.of_bits(bits), CfaPattern.bayer(6)
    rounding, even = calibration.scale()[-1] / 12**0.5, np.full((400, 600), 99, np.uint16)
    for sigma, expected in (
        (0.02, np.hypot(0.02, rounding)),
        (1e-5, np.hypot(1e-5, rounding)),
        (0, 0),
    ):
        says = replace(calibration, noise=NoiseModel.gaussian(sigma, 4))
        frame = clean_frame(Mosaic(even, pattern, says))
        assert frame.noise.sigma(0) == pytest.approx(expected)
    floating = Mosaic((even / 300).astype(np.float32), pattern, says)
    assert clean_frame(floating).noise.sigma(0) == 0


def test_a_black_mask_around_the_picture_is_not_without_noise() -> None:
    true = NoiseModel((5e-4,) * 4, (0.01,) * 4)
    mosaic = noisy(smooth((400, 600)), CfaPattern.bayer(6), true)
    samples = mosaic.signal.copy()
    samples[:60] = samples[-60:] = 0
    for signal in (0.2, 0.5, 1.5):
        found = estimate_noise(replace(mosaic, samples=samples)).sigma(signal)
        assert found == pytest.approx(true.sigma(signal), rel=ACCURACY)


def test_an_estimate_is_no_sigma_of_chromaticity() -> None:
    """Texture raises it: with it Eqs. 8-9 are those of a shot without noise, with a calibrated
    model they are not.
    """
    model = NoiseModel.gaussian(0.02, 4)
    unknown = noisy(smooth((400, 600)), CfaPattern.bayer(6), model)
    known = replace(unknown, calibration=replace(unknown.calibration, noise=model))
    assert unknown.calibration.noise is None
    assert sigma_z(clean_frame(known)) == pytest.approx(0.02)
    assert clean_frame(unknown).noise is not None
    assert sigma_z(clean_frame(unknown)) < 1e-5
