"""Denoised luminance: the same in steps and in frames of other sizes, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.settings import BEST
from panchroma.offline.stages.denoising import denoise_luminance
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import gamma_of, materials
from tests.reference.compare import assert_close
from tests.reference.sensor import observe

MODELS = [
    NoiseModel.gaussian(0.05, 4),
    NoiseModel((2e-3,) * 4, (0.02,) * 4),
    NoiseModel((3e-3,) * 4, (0.0,) * 4),
]
SETTINGS = BEST.denoising


def wave(shape: tuple[int, int]) -> DoubleArray:
    row, column = np.indices(shape)
    return 0.6 + 0.2 * np.sin(row / 25) * np.cos(column / 30)


def noisy(clean: DoubleArray, model: NoiseModel, filled: float = 1.0) -> tuple[Mosaic, FloatArray]:
    """A mosaic whose calibration has this noise, and a plane with it; at the colour sites it is
    `filled` times as strong.
    """
    pattern = CfaPattern.bayer(6, origin=(2, 3))
    mosaic = observe(materials(clean.shape, 3), pattern, gamma_of(pattern))
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=model))
    strength = np.where(pattern.panchromatic_mask(clean.shape), 1, filled)
    noise = np.random.default_rng(3).normal(size=clean.shape) * strength * deviation(clean, model)
    return mosaic, (clean + noise).astype(np.float32)


def deviation(clean: DoubleArray, model: NoiseModel) -> DoubleArray:
    return np.sqrt(model.shot[-1] * clean + model.read[-1] ** 2)


def test_clear_light_stays() -> None:
    """Coefficients far above the noise are kept."""
    mosaic, _ = noisy(wave((48, 60)), NoiseModel.gaussian(1e-4, 4))
    clear = wave((48, 60)).astype(np.float32)
    assert_close(denoise_luminance(clear, mosaic, SETTINGS), clear, 1e-3)


@pytest.mark.parametrize("model", MODELS)
def test_noise_goes(model: NoiseModel) -> None:
    clean = wave((120, 130)) + 0.8 * (np.indices((120, 130)).sum(axis=0) > 120)
    mosaic, plane = noisy(clean, model)
    found = denoise_luminance(plane, mosaic, SETTINGS)
    assert np.square(found - clean).mean() < np.square(plane - clean).mean() / 10


@pytest.mark.parametrize("model", MODELS)
def test_errors_of_filled_samples_fall_below_the_noise(model: NoiseModel) -> None:
    """Errors of three times the noise at the colour sites: the second pass does not see them. If it
    did, 1.3 times the noise would be left.
    """
    clean = wave((120, 130))
    mosaic, plane = noisy(clean, model, filled=3)
    error = (denoise_luminance(plane, mosaic, SETTINGS) - clean) / deviation(clean, model)
    sites = ~mosaic.pattern.panchromatic_mask(clean.shape)
    assert np.sqrt(np.square(error[sites]).mean()) < 1


def test_windows_leave_no_trace() -> None:
    """A window sees all that its pixels depend on: seams would show where frames of other sizes
    have none.
    """
    mosaic, plane = noisy(wave((300, 530)), MODELS[0])
    cut = Mosaic(mosaic.signal[:, :200].copy(), mosaic.pattern, mosaic.calibration)
    whole = denoise_luminance(plane, mosaic, SETTINGS)
    found = denoise_luminance(plane[:, :200].copy(), cut, SETTINGS)
    assert np.array_equal(found[:, :170], whole[:, :170])
