"""Pooled chromaticities: true to the constraint, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.settings import BEST
from panchroma.offline.stages.chromaticity import estimate_chromaticities
from panchroma.offline.stages.pooling import pool_blocks
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import cleaned, every_case, gamma_of, materials, shot
from tests.offline.stage_tests import StageTests
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe

SETTINGS = BEST.pooling


def blocks_of(mosaic: Mosaic, light: FloatArray) -> FloatArray:
    """Chromaticities of all blocks, each by itself."""
    return estimate_chromaticities(cleaned(mosaic), light, replace(BEST.chromaticity, taps=1))


def taken(scene: DoubleArray, noise: NoiseModel, pattern: CfaPattern) -> tuple[Mosaic, FloatArray]:
    """A noisy mosaic, and its true luminance."""
    clean = observe(scene, pattern, gamma_of(pattern))
    planes = pattern.filter_map(clean.shape)
    deviation = np.sqrt(np.array(noise.shot)[planes] * clean.signal + np.square(noise.read)[planes])
    samples = clean.signal + np.random.default_rng(0).normal(size=clean.shape) * deviation
    mosaic = replace(
        clean,
        samples=samples.astype(np.float32),
        calibration=replace(clean.calibration, noise=noise),
    )
    return mosaic, luminance_of(scene, gamma_of(pattern)).astype(np.float32)


class TestPooling(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        light = np.full(
            mosaic.shape,
            mosaic.signal[mosaic.pattern.panchromatic_mask(mosaic.shape)].mean(),
            np.float32,
        )
        return pool_blocks(blocks_of(mosaic, light), cleaned(mosaic), light, SETTINGS)


@every_case
def test_channels_add_up_and_errors_fall(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    planes = len(pattern.planes)
    even = np.linspace(1, 2, planes)
    for noise in (
        NoiseModel.gaussian(0.03, planes),
        NoiseModel(tuple(1e-3 * even), tuple(0.01 * even[::-1])),
    ):
        mosaic, light = taken(materials(shape, len(pattern.channels)), noise, pattern)
        pooled = pool_blocks(blocks_of(mosaic, light), cleaned(mosaic), light, SETTINGS)
        assert pooled.dtype == np.float32
        # Eq. 7
        assert_close(pooled @ np.array(mosaic.calibration.gamma), np.ones(pooled.shape[:2]), 1e-5)


def test_noise_goes_and_edges_stay() -> None:
    """Two colours side by side, each flat: errors fall with the number of blocks of a colour, and
    neither takes from the other.
    """
    pattern = CfaPattern.bayer(6)
    scene = np.where(np.arange(240)[:, None] < 120, [0.6, 0.3, 0.2], [0.2, 0.35, 0.55])[
        None
    ].repeat(240, axis=0)
    mosaic, light = taken(scene, NoiseModel.gaussian(0.03, 4), pattern)
    coarse = blocks_of(mosaic, light)
    true = blocks_of(*taken(scene, NoiseModel.gaussian(0.0, 4), pattern))
    pooled = pool_blocks(coarse, cleaned(mosaic), light, SETTINGS)
    assert np.square(pooled - true).mean() < np.square(coarse - true).mean() / 25
    assert np.abs(pooled - true).max() < 0.2 * np.abs(true[0, 0] - true[0, -1]).max()


def test_dark_colour_does_not_fade() -> None:
    """Each block by itself is pulled a tenth of its way to grey; all of them together know
    better.
    """
    colour = np.array([0.06, 0.02, 0.02])
    mosaic, light = taken(
        np.broadcast_to(colour, (240, 240, 3)), NoiseModel.gaussian(0.03, 4), CfaPattern.bayer(6)
    )
    pooled = pool_blocks(blocks_of(mosaic, light), cleaned(mosaic), light, SETTINGS)
    grey, true = mosaic.calibration.grey, colour / light.mean()
    assert_close((pooled.mean(axis=(0, 1)) - grey) / (true - grey), np.ones(3), 0.06)


@pytest.mark.parametrize("noise", [None, NoiseModel.gaussian(0.0, 4)])
def test_without_noise_blocks_are_left_alone(noise: NoiseModel | None) -> None:
    mosaic = shot(CfaPattern.bayer(6), (40, 40))
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=noise))
    coarse = blocks_of(mosaic, mosaic.signal)
    assert pool_blocks(coarse, cleaned(mosaic), mosaic.signal, SETTINGS) is coarse


def test_darkness_is_defined() -> None:
    """A block without light, by a sensor whose noise is all of light."""
    mosaic, light = taken(
        np.zeros((40, 40, 3)), NoiseModel((1e-3,) * 4, (0.0,) * 4), CfaPattern.bayer(6)
    )
    pooled = pool_blocks(blocks_of(mosaic, light), cleaned(mosaic), light, SETTINGS)
    assert_close(pooled, np.full_like(pooled, mosaic.calibration.grey), 1e-6)
