"""Pooled chromaticities: true to the constraint, and worth it."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import clean_frame, render
from panchroma.offline.frame import BlockSums
from panchroma.offline.settings import BEST
from panchroma.offline.stages.chromaticity import estimate_chromaticities
from panchroma.offline.stages.pooling import (
    chromaticity_variance,
    pool_blocks,
    precise_sums,
)
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.offline.scenes import cleaned, every_case, gamma_of, materials, shot
from tests.offline.stage_tests import StageTests
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe
from tests.scenes import darker_corners

SETTINGS = BEST.pooling


def blocks_of(mosaic: Mosaic, light: FloatArray) -> FloatArray:
    """Chromaticities of all blocks, each by itself."""
    return estimate_chromaticities(
        cleaned(mosaic), light, replace(BEST.chromaticity, repetitions=0)
    )


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
    assert np.mean(kept) > {48: 0.58, 72: 0.79, 96: 0.865}[side]


@pytest.mark.parametrize("level", [0.01, 0.03, 0.1, 0.3, 0.6])
def test_the_variance_of_a_chromaticity_is_its_squared_error(level: float) -> None:
    """Colours as likely as the prior says, from dark to bright, with the noise and the clipping of
    a sensor behind a lens with dark corners: two of three channels are free. Without the prior the
    variance would be up to 140 times as large.
    """
    pattern, shape, random = CfaPattern.bayer(6), (252, 252), np.random.default_rng(0)
    noise, lens = NoiseModel((1e-3,) * 4, (0.02,) * 4), darker_corners(shape, colour=0.4)
    camera = SensorCalibration.of_bits(12, headroom=False, noise=noise, shading=lens)
    grey, deviation = camera.grey, 0.42 * camera.grey
    colours = random.normal(0, deviation, (42, 42, 3))
    colours += grey - colours.mean(axis=2, keepdims=True)  # Eq. 7
    truth = colours.repeat(6, axis=0).repeat(6, axis=1)
    scene = (3 * level * truth).clip(0)
    scene[:, :40] = 3
    mosaic = simulate_sensor(scene.astype(np.float32), pattern, camera, 1.0, random)
    frame, gain = clean_frame(mosaic), lens.of_plane(shape)
    rows, columns = frame.sites.pixels
    blocks = np.full((3, *frame.sites.shape), grey, np.float32)
    sums, _ = precise_sums(frame, (3 * level / gain).astype(np.float32), blocks, 0.0)
    expected = np.moveaxis(blocks, 0, 2)
    weight, product = np.moveaxis(sums.astype(np.float64).reshape(2, 3, *sums.shape[1:]), 1, 3)
    found = BlockSums(weight, product).solved(1 / deviation, frame.gamma, expected)
    error = np.square(found - truth[rows, columns][:, :, 0]).mean(axis=2)
    variance = chromaticity_variance(sums, 1 / deviation)
    unclipped = replace(frame, lost=None).unclipped
    assert 0.05 < np.mean(~unclipped) < 0.3
    gains = gain[rows, columns][:, :, 0]
    for low, high in ((1, 1.7), (1.7, 2.4), (2.4, 4)):
        place = unclipped & (gains >= low) & (gains < high) & (columns[:, :, 0] > 52)
        assert error[place].mean() / variance[place].mean() == pytest.approx(2 / 3, rel=0.2)


@pytest.mark.parametrize("noise", [None, NoiseModel.gaussian(0.0, 4)])
def test_without_noise_blocks_are_left_alone(noise: NoiseModel | None) -> None:
    mosaic = shot(CfaPattern.bayer(6), (40, 40))
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=noise))
    coarse = blocks_of(mosaic, mosaic.signal)
    pooled = pool_blocks(coarse, cleaned(mosaic), mosaic.signal, SETTINGS)
    assert np.array_equal(pooled, coarse)


def test_darkness_is_defined() -> None:
    """A block without light, by a sensor whose noise is all of light."""
    mosaic, light = taken(
        np.zeros((40, 40, 3)), NoiseModel((1e-3,) * 4, (0.0,) * 4), CfaPattern.bayer(6)
    )
    pooled = pool_blocks(blocks_of(mosaic, light), cleaned(mosaic), light, SETTINGS)
    assert_close(pooled, np.full_like(pooled, mosaic.calibration.grey), 1e-6)
