"""Pooled chromaticities: true to the constraint, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import Frame, render
from panchroma.offline.settings import BEST
from panchroma.offline.stages.chromaticity import estimate_chromaticities
from panchroma.offline.stages.pooling import pool_blocks
from panchroma.shared import CfaPattern, NoiseModel, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.tools.simulation.sensor import simulate_additive
from tests.offline.scenes import every_case, gamma_of, materials, sampled
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe


def blocks_of(frame: Frame) -> FloatArray:
    """Chromaticities of all blocks, each by itself."""
    return estimate_chromaticities(frame, replace(BEST.chromaticity, repetitions=0))


def pooled_of(frame: Frame) -> FloatArray:
    return pool_blocks(blocks_of(frame), frame, BEST.pooling)


def taken(scene: DoubleArray, noise: NoiseModel, pattern: CfaPattern) -> Frame:
    """A noisy mosaic, with its true luminance."""
    clean = observe(scene, pattern, gamma_of(pattern))
    planes = pattern.filter_map(clean.shape)
    deviation = np.sqrt(np.array(noise.shot)[planes] * clean.signal + np.square(noise.read)[planes])
    samples = clean.signal + np.random.default_rng(0).normal(size=clean.shape) * deviation
    known = replace(clean.calibration, noise=noise)
    mosaic = replace(clean, samples=samples.astype(np.float32), calibration=known)
    return sampled(mosaic, luminance_of(scene, gamma_of(pattern)).astype(np.float32))


@every_case
def test_channels_add_up_and_errors_fall(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    planes = len(pattern.planes)
    even = np.linspace(1, 2, planes)
    uneven = NoiseModel(tuple(1e-3 * even), tuple(0.01 * even[::-1]))
    for noise in (NoiseModel.gaussian(0.03, planes), uneven):
        frame = taken(materials(shape, len(pattern.channels)), noise, pattern)
        pooled = pooled_of(frame)
        assert pooled.dtype == np.float32
        assert_close(pooled @ frame.gamma, np.ones(pooled.shape[:2]), 1e-5)  # Eq. 7


def test_noise_goes_and_edges_stay() -> None:
    """Two colours side by side, each flat: errors fall with the number of blocks of a colour, and
    neither takes from the other.
    """
    pattern = CfaPattern.bayer(6)
    row = np.where(np.arange(240)[:, None] < 120, [0.6, 0.3, 0.2], [0.2, 0.35, 0.55])
    scene = np.broadcast_to(row, (240, 240, 3))
    noisy, clean = (taken(scene, NoiseModel.gaussian(sigma, 4), pattern) for sigma in (0.03, 0.0))
    coarse, true, pooled = blocks_of(noisy), blocks_of(clean), pooled_of(noisy)
    assert np.square(pooled - true).mean() < np.square(coarse - true).mean() / 25
    assert np.abs(pooled - true).max() < 0.2 * np.abs(true[0, 0] - true[0, -1]).max()


def test_dark_colour_does_not_fade() -> None:
    """Each block by itself is pulled a tenth of its way to grey; all of them together know
    better.
    """
    colour = np.array([0.06, 0.02, 0.02])
    even, noise = np.broadcast_to(colour, (240, 240, 3)), NoiseModel.gaussian(0.03, 4)
    frame = taken(even, noise, CfaPattern.bayer(6))
    grey, true = frame.mosaic.calibration.grey, colour / frame.luminance.mean()
    kept = (pooled_of(frame).mean(axis=(0, 1)) - grey) / (true - grey)
    assert_close(kept, np.ones(3), 0.06)


@pytest.mark.parametrize("side", [48, 72, 96])
def test_dark_colours_do_not_mix(side: int) -> None:
    """Squares of many colours, less bright than the noise. If the variance forgot its prior, 0.44,
    0.68 and 0.79 of the colour would be left.
    """
    kept = []
    for seed in range(3):
        random = np.random.default_rng(seed)
        colours = random.uniform(0.2, 1.8, (288 // side, 288 // side, 3))
        colours *= 0.02 / colours.mean(axis=2, keepdims=True)
        scene = colours.repeat(side, axis=0).repeat(side, axis=1).astype(np.float32)
        mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), 0.03, random)
        found, true = (rgb - rgb.mean(axis=2, keepdims=True) for rgb in (render(mosaic).rgb, scene))
        kept.append((found * true).sum() / (true * true).sum())
    assert np.mean(kept) > {48: 0.57, 72: 0.79, 96: 0.865}[side]


def test_darkness_is_defined() -> None:
    """A block without light, by a sensor whose noise is all of light."""
    noise = NoiseModel((1e-3,) * 4, (0.0,) * 4)
    frame = taken(np.zeros((40, 40, 3)), noise, CfaPattern.bayer(6))
    pooled = pooled_of(frame)
    assert_close(pooled, np.full_like(pooled, frame.mosaic.calibration.grey), 1e-6)
