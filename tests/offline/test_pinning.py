"""Colour pinned at scattered sites: what it is wherever the picture is cut, and what it is for."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, render
from panchroma.offline.bands import Band, apply_stage
from panchroma.offline.frame import Frame
from panchroma.offline.stages.correction import SiteResidual
from panchroma.offline.stages.pinning import Pinning
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.sensor import simulate_additive
from tests.offline.scenes import sampled, shot
from tests.reference.sensor import luminance_of

KODAK = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 3))
TILES = [
    "WBWG/BWGW/WGWR/GWRW",
    "RGB/WWW/GRR",
    "RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG",
    "RG/BW",
    "CWMW/WYWC",
]
# Luminance that changes is not filled exactly; most is missed in the hole of five pixels that one
# of the tiles has.
HOLES = 5e-3


def pictured(mosaic: Mosaic) -> tuple[Band, Frame]:
    """The picture before it is pinned: true luminance, and one colour everywhere; with what is
    known of the frame.
    """
    random = np.random.default_rng(4)
    light = (1 + 0.3 * random.normal(size=mosaic.shape)).clip(0.1).astype(np.float32)
    count = len(mosaic.pattern.channels)
    grey = np.float32(1 / sum(mosaic.calibration.gamma))
    blocks = np.full((*mosaic.pattern.grid(mosaic.shape).shape, count), grey)
    measured = replace(sampled(mosaic, light), blocks=blocks)
    return Band(0, light, np.full((*mosaic.shape, count), grey)), measured


def pinned(band: Band, measured: Frame) -> FloatArray:
    """Its chromaticity after it has been pinned by the samples of the frame."""
    missed = SiteResidual(measured)(band, (band.first, band.end))
    return Pinning(measured)(missed, (band.first, band.end)).chromaticity


@pytest.mark.parametrize("sigma", [None, 0.05])
@pytest.mark.parametrize("height", [40, 70, 333])
def test_it_does_not_matter_how_the_picture_arrives(sigma: float | None, height: int) -> None:
    band, measured = pictured(shot(KODAK, (333, 37), sigma))
    whole = pinned(band, measured)
    missed = SiteResidual(measured)(band, (0, 333))
    bands = (missed.rows(first, min(first + height, 333)) for first in range(0, 333, height))
    found = [band.chromaticity for band in apply_stage(bands, Pinning(measured), 333)]
    assert np.array_equal(np.concatenate(found), whole)
    assert np.abs(whole - band.chromaticity).max() > 0.1


@pytest.mark.parametrize("letters", TILES)
def test_one_colour_stays_one_colour(letters: str) -> None:
    pattern = CfaPattern.of_letters(letters, (2, 1))
    light = 0.5 + 0.4 * np.sin(np.indices((60, 70)).sum(axis=0) / 9)
    scene = (light[..., None] * np.array([0.8, 0.5, 0.3])).astype(np.float32)
    calibration = SensorCalibration(channels=pattern.channels, gamma=(0.9, 1.2, 1.0))
    found = render(simulate_additive(scene, pattern, calibration, 0.0, np.random.default_rng(0)))
    colour = scene[0, 0] / luminance_of(scene[:1, :1], calibration.gamma)[0, 0]
    assert np.abs(found.chromaticity - colour)[4:-4, 4:-4].max() < HOLES


def test_colour_that_changes_within_a_block_is_seen() -> None:
    """Stripes of colour, six pixels wide, under a texture: the block's one chromaticity blurs them,
    its sites do not.
    """
    row, column = np.indices((120, 120))
    stripe = np.clip(np.sin(np.pi * column / 6) * 3, -1, 1)[..., None]
    light = 0.6 + 0.02 * np.cos(row * column / 40.0) + 0.15 * stripe[..., 0]
    scene = (
        light[..., None] * (np.array([1.0, 1.0, 1.0]) + stripe * np.array([0.5, -0.1, -0.4]))
    ).astype(np.float32)
    mosaic = simulate_additive(scene, KODAK, SensorCalibration(), 0.0, np.random.default_rng(0))
    pinned = render(mosaic).rgb
    plain = render(mosaic, BEST.switched(False)).rgb
    inside = slice(8, -8)
    assert (
        np.square(pinned - scene)[inside, inside].mean()
        < 0.7 * np.square(plain - scene)[inside, inside].mean()
    )


def test_noise_alone_moves_nothing() -> None:
    band, measured = pictured(shot(KODAK, (90, 90), None))
    seen = band.luminance.copy()
    for channel, place in zip(measured.sites.channels, measured.sites.places, strict=True):
        seen[place] *= band.chromaticity[*place, channel]
    seen += np.random.default_rng(1).normal(0, 0.01, seen.shape).astype(np.float32)
    known = replace(measured.mosaic.calibration, noise=NoiseModel.gaussian(0.01, 4))
    noisy = replace(measured, mosaic=Mosaic(seen, measured.pattern, known))
    assert np.abs(pinned(band, noisy) - band.chromaticity).max() < 1e-6


def test_blocks_beside_clipped_samples_keep_their_colour() -> None:
    """Nobody knows how luminance runs there: neither their own sites nor a wide neighbourhood say
    more than they did.
    """
    band, measured = pictured(shot(KODAK, (90, 90), None))
    measured.blocks[:] = np.array([0.5, 0.2, 0.1], np.float32)
    clipped = replace(measured, clipping=-np.inf)
    assert np.abs(pinned(band, clipped) - band.chromaticity).max() < 1e-6
