import numpy as np
import pytest

from shared.arrays import DoubleArray, FloatArray
from tools.camera.bayer import ORDER, sample_bayer
from tools.evaluation.rivals.interpolation import demosaic_bilinear


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
