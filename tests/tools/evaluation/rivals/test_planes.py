"""The rivals that interpolate the planes of any pattern."""

from typing import Any

import numpy as np
import pytest

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.evaluation.rivals import planes as module
from tools.evaluation.rivals.interpolation import demosaic_bilinear
from tools.evaluation.rivals.planes import denoised_planes, planes, sharpened_planes
from tools.simulation.sensor import simulate_additive, simulate_sensor

PATTERNS = {
    "K=6": CfaPattern.bayer(6),
    "Kodak": CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", origin=(1, 2)),
    "Kaizu": CfaPattern.of_letters("RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG"),
    "five channels": CfaPattern.with_block(("AB", "CD", "EA"), period=7, origin=(3, 5)),
}
NOISE_FREE = 1e-5  # scene units: single precision


def ramp(rows: int, columns: int, channels: int) -> FloatArray:
    """Each channel is linear across the frame, in a direction of its own."""
    down, right = np.meshgrid(np.arange(rows) / rows, np.arange(columns) / columns, indexing="ij")
    slopes = np.linspace(0.1, 0.5, channels)
    return (0.2 + slopes * down[..., None] + slopes[::-1] * right[..., None]).astype(np.float32)


def shot(scene: FloatArray, pattern: CfaPattern, sigma: float = 0.0) -> Mosaic:
    return simulate_additive(scene, pattern, SensorCalibration(pattern.channels), sigma, np.random.default_rng(0))


@pytest.mark.parametrize("name", PATTERNS)
def test_a_linear_scene_comes_back(name: str) -> None:
    """Exactly, away from the border, where no site lies outside; in a frame that is not whole tiles."""
    pattern = PATTERNS[name]
    scene, edge = ramp(47, 53, len(pattern.channels)), pattern.period + 1
    picture = planes(shot(scene, pattern))
    assert picture.shape == scene.shape
    assert picture.dtype == np.float32
    np.testing.assert_allclose(picture[edge:-edge, edge:-edge], scene[edge:-edge, edge:-edge], atol=NOISE_FREE)
    assert np.abs(picture - scene).max() < 0.3  # and sensible at the border
    sharpened = sharpened_planes(shot(scene, pattern))
    np.testing.assert_allclose(sharpened[edge:-edge, edge:-edge], scene[edge:-edge, edge:-edge], atol=NOISE_FREE)


@pytest.mark.parametrize("name", PATTERNS)
def test_measured_samples_are_kept(name: str) -> None:
    pattern = PATTERNS[name]
    mosaic = shot(ramp(30, 30, len(pattern.channels)), pattern, 0.1)
    picture = planes(mosaic)
    for channel, rows, columns in pattern.lattices:
        np.testing.assert_allclose(picture[rows, columns, channel], mosaic.signal[rows, columns], rtol=1e-6)


def test_detail_that_only_panchromatic_pixels_see_sharpens_every_channel() -> None:
    scene = ramp(48, 48, 3)
    scene[20:23] += 0.2  # a stroke between two rows of blocks
    inner = (slice(20, 23), slice(8, -8))
    mosaic = shot(scene, PATTERNS["K=6"])
    assert np.abs(planes(mosaic)[inner] - scene[inner]).min() > 0.05
    np.testing.assert_allclose(sharpened_planes(mosaic)[inner], scene[inner], atol=1e-4)


def test_on_a_square_lattice_it_is_bilinear() -> None:
    """Green of Honda's tile lies on every second row and column, as red of a Bayer mosaic does."""
    samples = np.random.default_rng(0).random((48, 48)).astype(np.float32)
    honda = CfaPattern.of_letters("BWRW/WGWG/RWBW/WGWG", origin=(1, 1))  # green at the even places
    expected = demosaic_bilinear(samples)[8:-8, 8:-8, 0]
    np.testing.assert_allclose(planes(Mosaic(samples, honda, SensorCalibration()))[8:-8, 8:-8, 1], expected, atol=1e-4)


def test_a_frame_smaller_than_the_tile_is_refused() -> None:
    with pytest.raises(InputError, match="5 x 9 pixels is smaller than the tile of 6 x 6"):
        planes(Mosaic(np.zeros((9, 5), np.float32), CfaPattern.bayer(6), SensorCalibration()))


def test_denoising_first_lowers_noise() -> None:
    pytest.importorskip("bm3d", reason="the extra `rivals` is not installed")
    scene = ramp(64, 64, 3)
    noisy = simulate_sensor(scene, CfaPattern.bayer(4), SensorCalibration.of_bits(12), 0.1, np.random.default_rng(0))
    before, after = (np.std(each(noisy) / np.float32(0.1) - scene) for each in (planes, denoised_planes))
    assert after < 0.7 * before


@pytest.mark.parametrize(
    ("letters", "grids"),
    [
        ("BWRW/WGWG/RWBW/WGWG", [(12, 12)] * 4 + [(24, 24)]),  # Honda's green is one grid
        ("WBWG/BWGW/WGWR/GWRW", [(12, 12)] * 8),
    ],
)
def test_samples_on_one_grid_are_denoised_together(letters: str, grids: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    pattern, seen = CfaPattern.of_letters(letters), []

    def darken(plane: FloatArray, shot: float, read: float) -> FloatArray:
        assert (shot, read) == (0.0, 0.1)
        seen.append(plane.shape)
        return plane * np.float32(0.5)

    monkeypatch.setattr(module, "denoise_plane", darken)
    mosaic = shot(ramp(48, 48, 3), pattern, 0.1)
    np.testing.assert_allclose(denoised_planes(mosaic), planes(mosaic) / 2, atol=1e-6)
    assert sorted(seen) == grids
    quiet = shot(ramp(48, 48, 3), pattern)
    np.testing.assert_array_equal(denoised_planes(quiet), planes(quiet))
