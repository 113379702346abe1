"""Filters before a scene, and the protocols of noise: what cameras read, and what protocols say of
themselves.
"""

import re

import numpy as np
import pytest

from panchroma.shared import CfaPattern, FloatArray, InputError
from panchroma.shared.colorimetry import D50, SRGB_TO_XYZ, as_rows
from panchroma.tools.evaluation.cameras import CameraPair
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.bayer import sample_bayer
from panchroma.tools.simulation.filters import filters_for
from panchroma.tools.simulation.protocols import PaperProtocol, Protocol, SensorProtocol
from panchroma.tools.simulation.sensor import TYPICAL_READ, TYPICAL_SHOT

RNG = np.random.default_rng(5)


def scene_of(channels: str = "RGB", **fields: object) -> Scene:
    return Scene(RNG.random((12, 13, len(channels)), np.float32), "a", channels=channels, **fields)  # type: ignore[arg-type]


def pattern_of(block: str) -> CfaPattern:
    return CfaPattern.with_block(tuple(block.split("/")), 6)


@pytest.mark.parametrize("block", ["CM/YC", "CM/YG", "RG/BY", "CYM/GRB", "RC/MY", "RC", "YB", "GM"])
def test_filters_add_up_to_all_light(block: str) -> None:
    filters = filters_for(pattern_of(block), scene_of())
    assert min(filters.gamma) > 0
    np.testing.assert_allclose(np.sum(filters.matrix, axis=1), 1)
    collected = np.array(filters.gamma) @ filters.matrix
    np.testing.assert_allclose(collected, collected.mean(), atol=1e-9)  # of each channel as much


@pytest.mark.parametrize("block", ["CM/YC", "YC/GM", "CYM/GRB"])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("neutral", [(1.0, 1.0, 1.0), (0.5, 1.0, 0.7)])
def test_colours_survive_the_filters(block: str, known: bool, neutral: tuple[float, ...]) -> None:
    to_xyz = np.array(SRGB_TO_XYZ) / neutral
    scene = scene_of(camera_to_xyz=as_rows(to_xyz) if known else None, neutral=neutral)
    filters = filters_for(pattern_of(block), scene)
    matrix, white = map(np.array, filters.colours(scene))
    colours = filters.of(scene.rgb) @ matrix.T
    np.testing.assert_allclose(colours, scene.rgb @ to_xyz.T, atol=1e-5)
    np.testing.assert_allclose(matrix @ white, D50, atol=1e-9)


@pytest.mark.parametrize(
    ("block", "channels", "words"),
    [
        ("RX/GB", "RGB", "X, and the scene only R, G and B; use"),
        ("CM/YU", "RGB", "has the filters U"),
        ("CM/YC", "CMV", "has the filters Y, and the scene only C, M and V; use"),
        ("RY/BR", "RGB", "of R, Y and B that add up to it; there are none (the nearest: R 0, Y 2"),
    ],
)
def test_filters_that_cannot_be(block: str, channels: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        filters_for(pattern_of(block), scene_of(channels))


# --- protocols -----------------------------------------------------------------------------------

RGB = np.full((60, 66, 3), (0.2, 0.4, 0.3), np.float32)
PATTERN = CfaPattern.bayer(6)


def pair(level: Protocol, scene: FloatArray = RGB, seed: int = 0) -> CameraPair:
    return CameraPair(level, seed, scene, PATTERN, None)


def test_the_papers_protocol_adds_noise_and_nothing_else() -> None:
    np.testing.assert_array_equal(pair(PaperProtocol(0.0)).bayer.samples, sample_bayer(RGB))
    shot = pair(PaperProtocol(0.03), np.zeros_like(RGB)).bayer
    assert shot.samples.min() < -0.05
    assert shot.samples.std() == pytest.approx(0.03, rel=0.05)
    assert (shot.shot, shot.read) == (0.0, 0.03)
    sparse = pair(PaperProtocol(0.03)).sparse
    assert sparse.samples.dtype == np.float32
    assert sparse.calibration.noise.sigma(0.5) == pytest.approx(0.03)


@pytest.mark.parametrize("exposure", [1.0, 0.25, 1 / 16])
def test_equal_exposure_gives_the_panchromatic_pixel_its_light(exposure: float) -> None:
    cameras = pair(SensorProtocol(exposure))
    bayer, sparse = cameras.bayer, cameras.sparse
    white = sparse.signal[sparse.pattern.panchromatic_mask(sparse.shape)] / exposure
    green = bayer.samples[::2, 1::2]
    assert green.mean() == pytest.approx(0.4, rel=0.02)
    assert white.mean() == pytest.approx(0.9, rel=0.02)
    # Noise of the same electrons: variance per scene unit of light is the same, so the sum of three
    # has more signal to noise.
    noise = bayer.shot * exposure, bayer.read * exposure
    assert noise == pytest.approx((TYPICAL_SHOT, TYPICAL_READ))
    assert green.var() == pytest.approx(bayer.shot * 0.4 + bayer.read**2, rel=0.15)
    assert white.std() / white.mean() < 0.75 * green.std() / green.mean()
    codes = bayer.samples * exposure * (4095 - 256)
    np.testing.assert_allclose(codes, np.rint(codes), atol=2e-3)  # 12 bits, through float32


def test_levels_are_ordered_by_noise_checked_and_named() -> None:
    texts = [protocol.text for protocol in PaperProtocol.levels([0.03, 0.0, 0.01, 0.01])]
    assert texts == ["no noise", "sigma 0.01", "sigma 0.03"]
    texts = [protocol.text for protocol in SensorProtocol.levels([0.25, 2.0, 1.0])]
    assert texts == ["exposure 2", "exposure 1", "exposure 0.25"]
    conditions = "5,000 electrons per scene unit at exposure 1, read noise of 3 electrons, 12 bits"
    assert conditions in SensorProtocol.conditions
    for sigma in (np.nan, 1e4):
        with pytest.raises(InputError, match=r"`sigma` is .*, expected 0 to 1000"):
            PaperProtocol.levels([sigma])
    for level in (0.0, 1e7, np.inf):
        with pytest.raises(InputError, match=r"`light` is .* expected"):
            SensorProtocol.levels([level])
