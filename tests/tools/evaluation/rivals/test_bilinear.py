import numpy as np
import pytest

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError
from tests.bayer import bayer_mosaic
from tests.data import photograph
from tools.camera.bayer import ORDER, sample_bayer
from tools.evaluation.metrics import quality
from tools.evaluation.rivals.bilinear import demosaic_bilinear
from tools.scenes.load import load_scene


def literal(mosaic: FloatArray) -> DoubleArray:
    """Each missing value: the mean of its channel's samples among the eight neighbours, in the mirrored frame."""
    height, width = mosaic.shape
    padded = np.pad(mosaic.astype(float), 1, mode="reflect")
    rgb = np.empty((height, width, 3))
    for row in range(height):
        for column in range(width):
            for channel, letter in enumerate("RGB"):
                if ORDER[row % 2 * 2 + column % 2] == letter:
                    rgb[row, column, channel] = mosaic[row, column]
                    continue
                seen = [
                    padded[row + 1 + down, column + 1 + right]
                    for down in (-1, 0, 1)
                    for right in (-1, 0, 1)
                    if ORDER[(row + down) % 2 * 2 + (column + right) % 2] == letter
                ]
                rgb[row, column, channel] = np.mean(seen)
    return rgb


@pytest.mark.parametrize("shape", [(2, 2), (5, 8), (6, 7), (9, 9)])
def test_bilinear_is_the_mean_of_the_nearest_samples(shape: tuple[int, int]) -> None:
    mosaic = np.random.default_rng(1).random(shape).astype(np.float32)
    np.testing.assert_allclose(demosaic_bilinear(mosaic), literal(mosaic), atol=1e-6)  # float32 rounding


def test_the_mosaic_takes_each_sample_from_its_channel() -> None:
    rgb = np.random.default_rng(2).random((5, 6, 3)).astype(np.float32)
    mosaic = sample_bayer(rgb)
    for row, column in np.ndindex(5, 6):
        assert mosaic[row, column] == rgb[row, column, "RGB".index(ORDER[row % 2 * 2 + column % 2])]


def test_wrong_mosaics_are_refused() -> None:
    with pytest.raises(InputError, match="2 rows"):
        demosaic_bilinear(np.zeros((1, 4), np.float32))


# Established by an independent implementation of scene loading, metric and interpolation: medians of RGB, luminance, chrominance.
ESTABLISHED: dict[str, dict[float, tuple[float, float, float]]] = {
    "raw/rose.dng": {0: (50.6, 54.5, 53.0), 0.01: (41.6, 46.1, 43.3), 0.03: (32.6, 37.5, 34.4)},
    "raw/outdoor4.dng": {0: (49.5, 53.6, 51.6)},
    "raw/s40_pantone.crw": {0: (50.4, 55.1, 52.1)},
    "linear/intel_tau_003.png": {0: (49.9, 54.4, 51.9), 0.01: (41.5, 46.1, 43.3), 0.03: (32.6, 37.3, 34.3)},
    "linear/intel_tau_011.png": {0: (40.1, 42.5, 43.8), 0.01: (38.1, 41.2, 40.9), 0.03: (31.9, 36.2, 33.9)},
}
TOLERANCE = 0.15  # dB; half of it is how much the median moves with the draw of the noise on the small frames


@pytest.mark.parametrize("name", ESTABLISHED)
def test_established_figures_come_out(name: str) -> None:
    truth = load_scene(str(photograph(name))).rgb
    rows, columns = (size // 6 * 6 for size in truth.shape[:2])  # the figures are of frames cut to whole periods of 6
    truth = truth[:rows, :columns]
    for sigma, expected in ESTABLISHED[name].items():
        draws = range(3 if sigma else 1)
        found = [
            quality(demosaic_bilinear(bayer_mosaic(truth, sigma, np.random.default_rng(seed))), truth).median for seed in draws
        ]
        assert np.mean(found, axis=0) == pytest.approx(expected, abs=TOLERANCE)
