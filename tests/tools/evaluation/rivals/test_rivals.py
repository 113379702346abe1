"""All rivals at once: what each must hold whatever its quality; and DLMMSE, pixel by pixel as it is
defined. See also test_network.
"""

import numpy as np
import pytest

from panchroma.shared.arrays import FloatArray
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.evaluation.metrics import psnr
from panchroma.tools.evaluation.rivals.bm3d_dlmmse import denoise_bayer
from panchroma.tools.simulation.bayer import ORDER, sample_bayer
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


# --- interpolation --------------------------------------------------------------------------------


def green_of(mosaic: FloatArray, row: int, column: int) -> float:
    """Green at a red or blue site far from the border, word by word from sections II and III of the
    paper.
    """
    m = mosaic.astype(float)
    low_pass = np.array([4, 9, 15, 23, 26, 23, 15, 9, 4]) / 128

    def green(r: int, c: int) -> bool:
        return ORDER[r % 2 * 2 + c % 2] == "G"

    def value(n: int, step: tuple[int, int]) -> float:
        place = row + n * step[0], column + n * step[1]
        assert min(place) >= 0
        return float(m[place])

    # green minus the other colour of the line
    def difference(n: int, step: tuple[int, int]) -> float:
        middle = value(n, step)
        near, far = (value(n - by, step) + value(n + by, step) for by in (1, 2))
        other = near / 2 + (2 * middle - far) / 4
        return middle - other if green(row + n * step[0], column + n * step[1]) else other - middle

    estimates = []
    for step in ((0, 1), (1, 0)):
        y = {n: difference(n, step) for n in range(-8, 9)}
        smooth = {n: sum(low_pass[k + 4] * y[n + k] for k in range(-4, 5)) for n in range(-4, 5)}
        variance = np.var(list(smooth.values()), ddof=1)
        noise = np.mean([(smooth[n] - y[n]) ** 2 for n in range(-4, 5)]) + 0.1 / 255**2
        estimate = smooth[0] + variance / (variance + noise) * (y[0] - smooth[0])
        estimates.append((estimate, variance - variance**2 / (variance + noise) + 0.1 / 255**2))
    (h, h_error), (v, v_error) = estimates
    return float(m[row, column] + (h / h_error + v / v_error) / (1 / h_error + 1 / v_error))


def test_green_is_the_papers() -> None:
    mosaic = np.random.default_rng(5).random((30, 32)).astype(np.float32)
    picture = demosaic("dlmmse", mosaic)
    for row in range(11, 19):
        for column in range(12, 20):
            if ORDER[row % 2 * 2 + column % 2] != "G":
                expected = green_of(mosaic, row, column)
                assert picture[row, column, 1] == pytest.approx(expected, abs=1e-6)  # float32


@pytest.mark.parametrize("name", ["bilinear", "dlmmse"])
def test_measured_samples_stay(name: str) -> None:
    mosaic = np.random.default_rng(1).random((18, 20)).astype(np.float32)
    np.testing.assert_array_equal(sample_bayer(demosaic(name, mosaic)), mosaic)
