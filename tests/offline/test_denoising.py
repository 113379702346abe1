"""Denoised luminance: equal to the reference in pieces too, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.settings import BEST
from panchroma.offline.stages import denoising as product
from panchroma.offline.stages.denoising import cosines, denoise_luminance
from panchroma.offline.stages.luminance import recover_luminance
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import gamma_of, materials
from tests.offline.stage_tests import StageTests
from tests.reference import denoising as reference
from tests.reference.compare import assert_close
from tests.reference.sensor import observe

# Float32 sums, and weights by light that are even to a thousandth.
FLOAT32 = 5e-5
MODELS = [NoiseModel.gaussian(0.05, 4), NoiseModel((2e-3,) * 4, (0.02,) * 4), NoiseModel((3e-3,) * 4, (0.0,) * 4)]
SETTINGS = BEST.denoising


class TestDenoising(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        luminance = recover_luminance(mosaic, self.settings.luminance)
        return denoise_luminance(luminance, mosaic, self.settings.denoising)


def noisy(shape: tuple[int, int], model: NoiseModel) -> tuple[Mosaic, DoubleArray]:
    """A mosaic whose calibration has this noise, and a plane of panchromatic samples at all its pixels."""
    pattern = CfaPattern.bayer(6, origin=(2, 3))
    mosaic = observe(materials(shape, 3), pattern, gamma_of(pattern))
    clean = materials(shape, 3) @ np.array(gamma_of(pattern))
    deviation = np.sqrt(model.shot[-1] * clean + model.read[-1] ** 2)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=model))
    return mosaic, clean + np.random.default_rng(3).normal(size=shape) * deviation


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("piece", [512, 16, 7])
def test_equals_the_reference_in_any_pieces(model: NoiseModel, piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(product, "_PIECE", 1)
    monkeypatch.setattr(product, "_LEAST_ROWS", piece)
    mosaic, plane = noisy((45, 38), model)
    settings = replace(SETTINGS, strength=0.8)
    uncertain = ~mosaic.pattern.panchromatic_mask(mosaic.shape)
    expected = reference.denoise_luminance(plane, uncertain, model.shot[-1], model.read[-1], settings)
    assert_close(denoise_luminance(plane.astype(np.float32), mosaic, settings), expected, FLOAT32)


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


@pytest.mark.parametrize("model", [None, NoiseModel.gaussian(0.0, 4)])
def test_without_noise_the_samples_are_left_alone(model: NoiseModel | None) -> None:
    mosaic, plane = noisy((40, 50), MODELS[0])
    given = plane.astype(np.float32)
    silent = replace(mosaic, calibration=replace(mosaic.calibration, noise=model))
    assert denoise_luminance(given, silent, SETTINGS) is given
    assert denoise_luminance(given, mosaic, replace(SETTINGS, strength=0.0)) is given


@pytest.mark.parametrize(
    ("shape", "sizes"),
    [((7, 9), (8,)), ((9, 37), (4, 8)), ((19, 23), (8, 12)), ((31, 14), (16,)), ((140, 9), (4,)), ((8, 270), (8,))],
)
def test_equals_the_reference_with_blocks_of_any_size(shape: tuple[int, int], sizes: tuple[int, ...]) -> None:
    mosaic, plane = noisy(shape, MODELS[1])
    settings = replace(SETTINGS, sizes=sizes)
    uncertain = ~mosaic.pattern.panchromatic_mask(shape)
    expected = reference.denoise_luminance(plane, uncertain, MODELS[1].shot[-1], MODELS[1].read[-1], settings)
    assert_close(denoise_luminance(plane.astype(np.float32), mosaic, settings), expected, FLOAT32)


def test_windows_leave_no_trace() -> None:
    """A window sees all that its pixels depend on: seams would show where frames of other sizes have none."""
    mosaic, plane = noisy((300, 530), MODELS[0])
    part = Mosaic(mosaic.signal[:, :200].copy(), mosaic.pattern, mosaic.calibration)
    whole = denoise_luminance(plane.astype(np.float32), mosaic, SETTINGS)
    found = denoise_luminance(plane[:, :200].astype(np.float32), part, SETTINGS)
    assert np.array_equal(found[:, :170], whole[:, :170])


def test_cosines_are_orthonormal() -> None:
    for size in (4, 8, 12):
        assert_close(cosines(size).astype(np.float64) @ cosines(size).T, np.eye(size), 1e-6)
