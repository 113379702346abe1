"""All rivals at once: what each must hold whatever its quality."""

import numpy as np
import pytest

from panchroma.shared.arrays import FloatArray
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.evaluation.metrics import psnr
from panchroma.tools.evaluation.rivals.bm3d_dlmmse import denoise_bayer
from panchroma.tools.simulation.bayer import sample_bayer
from panchroma.tools.simulation.protocols import BayerShot

RIVALS = [name for name, method in methods().items() if not method.ours and method.missing is None]
CODE = 2 / 65535  # what 16 bits over a range of 1.3 may be wrong by
EDGE = 8  # pixels: rivals do as they like there


def demosaic(name: str, mosaic: FloatArray) -> FloatArray:
    return methods()[name].function(BayerShot(mosaic, 0.0, 0.0), np.ones(3, np.float32))


def smooth_scene(rows: int, columns: int) -> FloatArray:
    down, right = np.meshgrid(np.linspace(0, 3, rows), np.linspace(0, 4, columns), indexing="ij")
    planes = 0.5 + 0.3 * np.sin(down + right), 0.4 + 0.2 * np.cos(down), 0.3 + 0.2 * np.sin(right)
    return np.stack(planes, -1).astype(np.float32)


@pytest.mark.parametrize("name", RIVALS)
def test_colours_land_in_their_channels_and_an_even_one_comes_back(name: str) -> None:
    rgb = smooth_scene(62, 74)
    picture = demosaic(name, sample_bayer(rgb))
    assert picture.shape == rgb.shape
    assert picture.dtype == np.float32
    assert psnr(picture, rgb, EDGE) > 38
    even = np.broadcast_to(np.array([0.25, 0.5, 0.75], np.float32), (40, 44, 3))
    inner = demosaic(name, sample_bayer(even))[EDGE:-EDGE, EDGE:-EDGE]
    np.testing.assert_allclose(inner, even[EDGE:-EDGE, EDGE:-EDGE], atol=CODE)


@pytest.mark.parametrize("level", [0.0, 1.0])
@pytest.mark.parametrize("name", RIVALS)
def test_nothing_below_black_or_above_white_is_clipped(name: str, level: float) -> None:
    mosaic = (level + 0.05 * np.random.default_rng(0).standard_normal((60, 60))).astype(np.float32)
    picture = demosaic(name, mosaic)[EDGE:-EDGE, EDGE:-EDGE]
    assert picture.min() < level - 0.05
    assert picture.max() > level + 0.05
    assert picture.mean() == pytest.approx(level, abs=0.01)


def test_denoising_lowers_noise_and_keeps_the_light() -> None:
    remedy = "pip install -e '.[rivals]' (for non-commercial use only)"
    pytest.importorskip("bm3d", reason=f"BM3D: bm3d is not installed: {remedy}")
    truth = sample_bayer(smooth_scene(40, 40))
    rng = np.random.default_rng(0)
    shot, read = 2e-3, 5e-3
    noisy = rng.poisson(truth / shot) * shot + read * rng.standard_normal(truth.shape)
    before = noisy.astype(np.float32)
    after = denoise_bayer(BayerShot(before, shot, read))
    assert np.std(after - truth) < 0.5 * np.std(before - truth)
    assert np.mean(after - truth) == pytest.approx(np.mean(before - truth), abs=1e-3)
