"""Luminance of a burst against its literal transcription."""

import numpy as np
import pytest

from offline.burst import Motion
from offline.burst.frames import as_arrays, displaced
from offline.kernels.merging import merge
from shared import CfaPattern
from shared.arrays import ByteArray, DoubleArray, FloatArray
from tests.reference import burst as reference
from tests.reference.compare import assert_close
from tests.reference.geometry import keys

FLOAT32 = 2e-5  # four rounds of sums of float32, at places that are float32 as well
SHAPE, PATTERN = (26, 34), CfaPattern.bayer(6)
SHIFTS = np.linspace(-0.4, 0.5, 24, dtype=np.float32).reshape(3, 4, 2)
MOTIONS = [Motion(), Motion((0.6, -1.3), 0.01), Motion((-2.2, 0.4), -0.02, SHIFTS)]


def light(y: DoubleArray, x: DoubleArray) -> DoubleArray:
    """A scene of waves, of which the shortest are 5 pixels long."""
    return 1 + 0.4 * np.sin(y / 2.5) * np.cos(x / 3) + 0.2 * np.sin((x + y) / 1.2)


def burst(sigma: float, shape: tuple[int, int] = SHAPE, motions: list[Motion] = MOTIONS) -> FloatArray:
    random = np.random.default_rng(0)
    y, x = (each.astype(np.float32) for each in np.indices(shape))
    planes = [light(*(part.astype(np.float64) for part in motion.back(y, x, shape))) for motion in motions]
    return np.array([plane + random.normal(0, sigma, shape) for plane in planes]).astype(np.float32)


def merged(
    planes: FloatArray, agreement: ByteArray, noise: DoubleArray, motions: list[Motion] = MOTIONS
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Luminance, variance, and light and weight at the colour sites."""
    shape = planes.shape[1], planes.shape[2]
    grid = PATTERN.grid(shape)
    sites = np.array([(grid.whole_rows[0] + row, grid.whole_columns[0] + column) for row, column, _ in PATTERN.sites])
    out, variance = np.full((2, *shape), np.nan, np.float32)
    found = np.zeros((2, len(planes), len(grid.whole_rows), len(grid.whole_columns), len(sites)), np.float32)
    where = as_arrays(motions, shape)
    merge(planes, agreement, noise, PATTERN.panchromatic_mask(shape), where, sites, 6, out, variance, found[0], found[1])
    return out, variance, found[0], found[1]


@pytest.mark.parametrize("noise", [[[0, 0]] * 3, [[1e-3, 4e-4], [2e-3, 1e-4], [0, 9e-4]]])
def test_equals_the_reference(noise: list[list[float]]) -> None:
    model = np.array(noise, np.float64)
    planes = burst(0.03 if model.any() else 0.0)
    agreement = np.random.default_rng(1).choice(np.array([0, 60, 255], np.uint8), planes.shape, p=[0.1, 0.2, 0.7])
    agreement[0] = 255
    out, variance, light_at, weight = merged(planes, agreement, model)
    fine, spread = reference.merge(planes.astype(np.float64), agreement / 255, model, PATTERN.panchromatic_mask(SHAPE), MOTIONS)
    assert_close(out, fine[::2, ::2], FLOAT32)
    assert_close(variance, spread, FLOAT32)
    row, column, channel = PATTERN.sites[1]
    assert channel == 1
    grid = PATTERN.grid(SHAPE)
    at = grid.whole_rows[1] + row, grid.whole_columns[2] + column
    y, x = (float(each) for each in MOTIONS[2].back(np.array(at[0], np.float32), np.array(at[1], np.float32), SHAPE))
    assert weight[2, 1, 2, 1] == agreement[2, round(y), round(x)] / np.float32(255)
    if weight[2, 1, 2, 1]:
        assert light_at[2, 1, 2, 1] == pytest.approx(keys(fine, 2 * y, 2 * x), abs=1e-4)


def test_shows_more_than_one_frame_can() -> None:
    shape = 130, 180  # several tiles
    random = np.random.default_rng(2)
    motions = [Motion(), *(Motion((down, across)) for down, across in random.uniform(-2, 2, (7, 2)))]
    planes, agreement = burst(0.0, shape, motions), np.full((8, *shape), 255, np.uint8)
    holes = ~PATTERN.panchromatic_mask(shape)
    planes[:, holes] = 1  # nothing is known there
    y, x = np.indices(shape).astype(np.float64)
    out, variance, *_ = merged(planes, agreement, np.zeros((8, 2)), motions)
    inside = np.s_[4:-4, 4:-4]
    assert np.abs(out - light(y, x))[inside].max() < 0.02
    assert variance[inside].max() < 0.5
    alone, variance, *_ = merged(planes, agreement * (np.arange(8) == 0).astype(np.uint8)[:, None, None], np.zeros((8, 2)), motions)
    assert np.array_equal(alone[~holes], planes[0][~holes])
    assert variance.min() > 0.999


def test_displaces_a_frame() -> None:
    planes = burst(0.0)
    shown = displaced(planes[2], MOTIONS[2])
    down, across = MOTIONS[2].places(slice(None), SHAPE)
    outside = (down < -0.5) | (down >= SHAPE[0] - 0.5) | (across < -0.5) | (across >= SHAPE[1] - 0.5)
    assert np.array_equal(np.isnan(shown), outside)
    assert shown[13, 17] == pytest.approx(keys(planes[2].astype(np.float64), down[13, 17], across[13, 17]), abs=1e-5)


@pytest.mark.parametrize(
    "noise", [[[1e-3, 4e-4], [1e-3, 0], [0, 0]], [[0, 4e-4], [0, 0], [1e-3, 0]], [[1e-3, 0], [0, 0], [0, 1e6]]]
)
@pytest.mark.parametrize("light", [0.0, -1.5, 1.0])
def test_no_noise_model_takes_all_the_weight(noise: list[list[float]], light: float) -> None:
    planes = burst(0.03) * np.float32(0.1) + np.float32(light)
    out, variance, *_ = merged(planes, np.full(planes.shape, 255, np.uint8), np.array(noise, np.float64))
    assert np.isfinite(out).all()
    assert (variance > 0).all()
