"""The Bayer sensor under the same light: its filters, and what it measures under each protocol."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.pattern import BAYER_ORDERS


def sites(order: str) -> list[tuple[int, int, int]]:
    """(channel, row, column) of the four sites of a quad. Raises InputError unless `order` is one of BAYER_ORDERS."""
    if order not in BAYER_ORDERS:
        raise InputError(f"unknown Bayer order {order!r}; one of {', '.join(BAYER_ORDERS)}")
    return [("RGB".index(letter), place // 2, place % 2) for place, letter in enumerate(order)]


def channel_map(shape: tuple[int, ...], order: str) -> NDArray[np.uint8]:
    """The channel that each sample of a mosaic measures, (H, W). Raises InputError as `sites` does."""
    channels = np.empty(shape, np.uint8)
    for channel, row, column in sites(order):
        channels[row::2, column::2] = channel
    return channels


def check_mosaic(mosaic: FloatArray, order: str = "RGGB") -> None:
    """Raise InputError unless a mosaic has two axes of at least two samples, and `order` is one of BAYER_ORDERS."""
    if mosaic.ndim != 2 or min(mosaic.shape) < 2:
        raise InputError(f"a Bayer mosaic has at least 2 rows and 2 columns; this one has shape {mosaic.shape}")
    sites(order)


def sample_bayer(rgb: FloatArray, order: str = "RGGB") -> FloatArray:
    """Samples of a noiseless Bayer sensor, float32 (H, W), from a scene (H, W, 3), both in scene units."""
    mosaic: FloatArray = np.empty(rgb.shape[:2], np.float32)
    for channel, row, column in sites(order):
        mosaic[row::2, column::2] = rgb[row::2, column::2, channel]
    return mosaic


def bayer_mosaic(rgb: FloatArray, sigma: float, rng: np.random.Generator, order: str = "RGGB") -> FloatArray:
    """Samples of a Bayer sensor with additive Gaussian noise, float32 (H, W), scene units, not clipped.

    rgb: the scene, (H, W, 3), scene units.
    sigma: standard deviation of the noise on every sample, scene units.
    order: filters of the first two rows, one of BAYER_ORDERS.
    Raises InputError for another order or a negative sigma.
    """
    if not 0 <= sigma < np.inf:
        raise InputError(f"sigma is {sigma}, expected 0 or more")
    mosaic = sample_bayer(rgb, order)
    if sigma:
        mosaic += (sigma * rng.standard_normal(mosaic.shape)).astype(np.float32)
    return mosaic


def bayer_exposure(
    rgb: FloatArray, noise: NoiseModel, exposure: float, levels: tuple[int, int], rng: np.random.Generator, order: str = "RGGB"
) -> FloatArray:
    """Samples of a Bayer sensor with the sparse-colour sensor's pixels and exposure time, float32 (H, W), quantised.

    The noise is that of the sensor in electrons. A Bayer pixel gets a third of a panchromatic pixel's light, and the camera's gain
    suits that: its white level reads 1 scene unit, and there it clips.

    rgb: the scene, (H, W, 3), scene units.
    noise: of the sensor, first channel.
    exposure: fraction of the scene's light that arrives; the samples are in scene units times this.
    levels: codes of black and white.
    order: filters of the first two rows, one of BAYER_ORDERS.
    Raises InputError for an exposure that is not positive, and an unknown order.
    """
    if not 0 < exposure < np.inf:
        raise InputError(f"exposure is {exposure}, expected a positive factor")
    light = sample_bayer(rgb, order) * exposure
    shot, read = noise.shot[0], noise.read[0]
    counted: Any = rng.poisson(np.maximum(light, 0) / shot) * shot if shot else light
    noisy = np.minimum(counted + rng.normal(0, 1, light.shape) * read, 1.0)
    black, white = levels
    codes = np.rint(noisy * (white - black) + black).clip(0, white)
    measured: FloatArray = ((codes - black) / (white - black)).astype(np.float32)
    return measured
