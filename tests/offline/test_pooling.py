"""Pooled chromaticities: equal to the reference, true to the constraint, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from offline.settings import BEST
from offline.stages.pooling import PoolingPass, PoolingSettings, pool_blocks
from shared import CfaPattern, Mosaic, NoiseModel
from shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import cleaned, every_case, gamma_of, materials
from tests.reference import chromaticity, pooling
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe

# Weighted means of float32 sums; the exponents of the weights are up to some tens.
FLOAT32 = 2e-5
SETTINGS = BEST.pooling
ONE_PASS = PoolingSettings((PoolingPass(0.0, 0.5, 1),), light=0.1, curvature_error=1.0)


def blocks_of(
    pattern: CfaPattern, shape: tuple[int, int], noise: NoiseModel, seed: int = 0, scene: DoubleArray | None = None
) -> tuple[Mosaic, FloatArray, DoubleArray]:
    """A noisy mosaic, its true luminance, and what the whole blocks measure each for itself."""
    gamma = gamma_of(pattern)
    rgb = materials(shape, len(pattern.channels), seed) if scene is None else scene
    clean = observe(rgb, pattern, gamma)
    planes = pattern.filter_map(shape)
    deviation = np.sqrt(np.array(noise.shot)[planes] * clean.signal + np.square(noise.read)[planes])
    samples = clean.signal + np.random.default_rng(seed).normal(size=shape) * deviation
    mosaic = Mosaic(samples.astype(np.float32), pattern, replace(clean.calibration, noise=noise))
    light = luminance_of(rgb, gamma)
    return mosaic, light.astype(np.float32), chromaticity.estimate(samples, light, pattern, gamma, 0.02)


def models(pattern: CfaPattern) -> list[NoiseModel]:
    planes = len(pattern.planes)
    even = np.linspace(1, 2, planes)
    return [NoiseModel.gaussian(0.03, planes), NoiseModel(tuple(1e-3 * even), tuple(0.01 * even[::-1]))]


@every_case
@pytest.mark.parametrize("settings", [SETTINGS, ONE_PASS], ids=["best", "one pass"])
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], settings: PoolingSettings) -> None:
    for noise in models(pattern):
        mosaic, light, coarse = blocks_of(pattern, shape, noise)
        gamma = mosaic.calibration.gamma
        sums = pooling.statistics(
            mosaic.signal.astype(np.float64), light.astype(np.float64), coarse, pattern, gamma, noise, settings.curvature_error
        )
        expected = chromaticity.extend(
            pooling.pool(coarse, sums, gamma, pattern, settings.passes, settings.light, noise), pattern, shape
        )
        given = chromaticity.extend(coarse, pattern, shape).astype(np.float32)
        found = pool_blocks(given, cleaned(mosaic), light, settings)
        assert found.dtype == np.float32
        assert_close(found, expected, FLOAT32)
        assert_close(found @ np.array(gamma), np.ones(found.shape[:2]), 1e-5)  # Eq. 7


def test_noise_goes_and_edges_stay() -> None:
    """Two colours side by side, each flat: errors fall with the number of blocks of a colour, and neither takes from the other."""
    pattern, shape = CfaPattern.bayer(6), (240, 240)
    scene = np.where(np.arange(240)[:, None] < 120, [0.6, 0.3, 0.2], [0.2, 0.35, 0.55])[None].repeat(240, axis=0)
    noise = NoiseModel.gaussian(0.03, 4)
    mosaic, light, coarse = blocks_of(pattern, shape, noise, scene=scene)
    true = blocks_of(pattern, shape, NoiseModel.gaussian(0.0, 4), scene=scene)[2]
    given = chromaticity.extend(coarse, pattern, shape).astype(np.float32)
    found = pool_blocks(given, cleaned(mosaic), light, SETTINGS)
    found = found[pattern.grid(shape).inside].reshape(true.shape)
    assert np.square(found - true).mean() < np.square(coarse - true).mean() / 25
    assert np.abs(found - true).max() < 0.2 * np.abs(true[0, 0] - true[0, -1]).max()


def test_dark_colour_does_not_fade() -> None:
    """Each block by itself is pulled a tenth of its way to grey; all of them together know better."""
    pattern, shape = CfaPattern.bayer(6), (240, 240)
    mosaic, light, coarse = blocks_of(
        pattern, shape, NoiseModel.gaussian(0.03, 4), scene=np.broadcast_to([0.06, 0.02, 0.02], (*shape, 3))
    )
    given = chromaticity.extend(coarse, pattern, shape).astype(np.float32)
    grey, true = mosaic.calibration.grey, np.array([0.06, 0.02, 0.02]) / light.mean()
    kept = (pool_blocks(given, cleaned(mosaic), light, SETTINGS).mean(axis=(0, 1)) - grey) / (true - grey)
    assert_close(kept, np.ones(3), 0.06)


@pytest.mark.parametrize("noise", [None, NoiseModel.gaussian(0.0, 4)])
def test_without_noise_blocks_are_left_alone(noise: NoiseModel | None) -> None:
    mosaic, light, coarse = blocks_of(CfaPattern.bayer(6), (40, 40), NoiseModel.gaussian(0.01, 4))
    given = coarse.astype(np.float32)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=noise))
    assert pool_blocks(given, cleaned(mosaic), light, SETTINGS) is given


def test_darkness_is_defined() -> None:
    """A block without light, by a sensor whose noise is all of light."""
    noise = NoiseModel((1e-3,) * 4, (0.0,) * 4)
    mosaic, light, coarse = blocks_of(CfaPattern.bayer(6), (40, 40), noise, scene=np.zeros((40, 40, 3)))
    found = pool_blocks(chromaticity.extend(coarse, mosaic.pattern, (40, 40)).astype(np.float32), cleaned(mosaic), light, SETTINGS)
    assert_close(found, np.full_like(found, mosaic.calibration.grey), 1e-6)
