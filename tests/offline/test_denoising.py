"""Denoised luminance: the same in steps and in frames of other sizes, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.settings import BEST
from panchroma.offline.stages import denoising as product
from panchroma.offline.stages.denoising import denoise_luminance
from panchroma.offline.stages.luminance import recover_luminance
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import gamma_of, materials
from tests.offline.stage_tests import StageTests
from tests.reference.compare import assert_close
from tests.reference.sensor import observe

# Float32 sums.
FLOAT32 = 5e-5
MODELS = [
    NoiseModel.gaussian(0.05, 4),
    NoiseModel((2e-3,) * 4, (0.02,) * 4),
    NoiseModel((3e-3,) * 4, (0.0,) * 4),
]
SETTINGS = BEST.denoising


class TestDenoising(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        luminance = recover_luminance(mosaic, self.settings.luminance)
        return denoise_luminance(luminance, mosaic, self.settings.denoising)


def noisy(shape: tuple[int, int], model: NoiseModel) -> tuple[Mosaic, DoubleArray]:
    """A mosaic whose calibration has this noise, and a plane of panchromatic samples at all its
    pixels.
    """
    pattern = CfaPattern.bayer(6, origin=(2, 3))
    mosaic = observe(materials(shape, 3), pattern, gamma_of(pattern))
    clean = materials(shape, 3) @ np.array(gamma_of(pattern))
    deviation = np.sqrt(model.shot[-1] * clean + model.read[-1] ** 2)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=model))
    return mosaic, clean + np.random.default_rng(3).normal(size=shape) * deviation


@pytest.mark.parametrize("shape", [(45, 38), (7, 9), (9, 37), (140, 9), (8, 270)])
@pytest.mark.parametrize("sizes", [(4, 8, 12), (16,)])
def test_steps_equal_the_whole(
    shape: tuple[int, int], sizes: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    mosaic, plane = noisy(shape, MODELS[1])
    settings, luminance = replace(SETTINGS, sizes=sizes), plane.astype(np.float32)
    whole = denoise_luminance(luminance, mosaic, settings)
    monkeypatch.setattr(product, "_PIXELS", 1)
    for rows in (16, 7):
        monkeypatch.setattr(product, "_LEAST_ROWS", rows)
        assert_close(denoise_luminance(luminance, mosaic, settings), whole, FLOAT32)


def test_clear_light_stays() -> None:
    """Coefficients far above the noise are kept."""
    mosaic, _ = noisy((48, 60), NoiseModel.gaussian(1e-4, 4))
    row, column = np.indices(mosaic.shape)
    clear = (0.6 + 0.2 * np.sin(row / 9) * np.cos(column / 7)).astype(np.float32)
    assert_close(denoise_luminance(clear, mosaic, SETTINGS), clear, 1e-3)


@pytest.mark.parametrize("model", MODELS)
def test_noise_goes(model: NoiseModel) -> None:
    shape = (120, 130)
    mosaic, _ = noisy(shape, model)
    row, column = np.indices(shape)
    clean = 0.6 + 0.4 * np.sin(row / 25) * np.cos(column / 30) + 0.8 * (row + column > 120)
    deviation = np.sqrt(model.shot[-1] * clean + model.read[-1] ** 2)
    plane = clean + np.random.default_rng(3).normal(size=shape) * deviation
    found = denoise_luminance(plane.astype(np.float32), mosaic, SETTINGS)
    assert np.square(found - clean).mean() < np.square(plane - clean).mean() / 10


@pytest.mark.parametrize("model", MODELS)
def test_errors_of_filled_samples_fall_below_the_noise(model: NoiseModel) -> None:
    """Errors of three times the noise at the colour sites: the second pass does not see them. If it
    did, 1.3 times the noise would be left.
    """
    shape, random = (120, 130), np.random.default_rng(3)
    mosaic, _ = noisy(shape, model)
    row, column = np.indices(shape)
    clean = 0.6 + 0.1 * np.sin(row / 25) * np.cos(column / 30)
    deviation = np.sqrt(model.shot[-1] * clean + model.read[-1] ** 2)
    filled = ~mosaic.pattern.panchromatic_mask(shape)
    plane = clean + random.normal(size=shape) * deviation * np.where(filled, 3, 1)
    found = denoise_luminance(plane.astype(np.float32), mosaic, SETTINGS)
    assert np.sqrt(np.square((found - clean) / deviation)[filled].mean()) < 1


@pytest.mark.parametrize("model", [None, NoiseModel.gaussian(0.0, 4)])
def test_without_noise_the_samples_are_left_alone(model: NoiseModel | None) -> None:
    mosaic, plane = noisy((40, 50), MODELS[0])
    given = plane.astype(np.float32)
    silent = replace(mosaic, calibration=replace(mosaic.calibration, noise=model))
    assert denoise_luminance(given, silent, SETTINGS) is given
    assert denoise_luminance(given, mosaic, replace(SETTINGS, strength=0.0)) is given


def test_windows_leave_no_trace() -> None:
    """A window sees all that its pixels depend on: seams would show where frames of other sizes
    have none.
    """
    mosaic, plane = noisy((300, 530), MODELS[0])
    cut = Mosaic(mosaic.signal[:, :200].copy(), mosaic.pattern, mosaic.calibration)
    whole = denoise_luminance(plane.astype(np.float32), mosaic, SETTINGS)
    found = denoise_luminance(plane[:, :200].astype(np.float32), cut, SETTINGS)
    assert np.array_equal(found[:, :170], whole[:, :170])
