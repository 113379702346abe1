"""Luminance of a burst: what it keeps, gains and never does."""

import numpy as np
import pytest

from offline.burst import Motion
from offline.burst.frames import as_arrays, displaced
from offline.burst.merging import merge
from shared import CfaPattern
from shared.arrays import ByteArray, DoubleArray, FloatArray
from tests.reference.compare import assert_close
from tests.reference.geometry import keys

FLOAT32 = 2e-5
SLOPE = 1e-3  # local shifts are inverted in a few rounds, and interpolated
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
def test_a_slope_stays_a_slope_whatever_frames_agree(noise: list[list[float]]) -> None:
    """And it is what each colour sample sees, where its frame agrees."""

    def slope(y: DoubleArray, x: DoubleArray) -> DoubleArray:
        return 1 + 0.02 * y - 0.01 * x

    rows, columns = np.indices(SHAPE).astype(np.float32)
    places = [[place.astype(np.float64) for place in motion.back(rows, columns, SHAPE)] for motion in MOTIONS]
    planes = np.array([slope(*place) for place in places]).astype(np.float32)
    agreement = np.random.default_rng(1).choice(np.array([0, 60, 255], np.uint8), planes.shape, p=[0.1, 0.2, 0.7])
    agreement[0] = 255
    out, variance, light_at, weight = merged(planes, agreement, np.array(noise, np.float64))
    inside = np.s_[6:-6, 6:-6]
    assert_close(out[inside], slope(*np.indices(SHAPE).astype(np.float64))[inside], SLOPE)
    assert ((variance > 0) & (variance <= 1)).all()
    grid = PATTERN.grid(SHAPE)
    for frame, site in np.ndindex(len(MOTIONS), len(PATTERN.sites)):
        row, column, _ = PATTERN.sites[site]
        y, x = (float(place[grid.whole_rows[1] + row, grid.whole_columns[2] + column]) for place in places[frame])
        agrees = agreement[frame, round(y), round(x)] / np.float32(255)
        assert weight[frame, 1, 2, site] == agrees
        if agrees:
            assert light_at[frame, 1, 2, site] == pytest.approx(float(slope(np.array(y), np.array(x))), abs=SLOPE)


def test_the_noise_of_frames_that_agree_is_averaged() -> None:
    planes = np.ones((4, *SHAPE), np.float32)
    _, variance, *_ = merged(planes, np.full(planes.shape, 255, np.uint8), np.full((4, 2), 1e-3), [Motion()] * 4)
    assert_close(variance, np.full(SHAPE, 0.25), FLOAT32)


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


def test_no_sample_is_lost_where_other_frames_see_a_part_of_the_scene_larger() -> None:
    """All of them fit wherever a frame is in the list: otherwise those of the last one are missing."""
    shape = 150, 230
    nodes = np.array([[(0, 0), (0, 0.3 * shape[1])], [(0.3 * shape[0], 0), (0.3 * shape[0], 0.3 * shape[1])]], np.float32)
    motions = [Motion(), Motion(local=nodes), Motion(local=nodes + 0.5)]
    planes, every, order = burst(0.1, shape, motions), np.full((3, *shape), 255, np.uint8), [0, 2, 1]
    noise = np.array([[0, 0.01]] * 3)
    in_order, _, _, _ = merged(planes, every, noise, motions)
    other, _, _, _ = merged(np.ascontiguousarray(planes[order]), every, noise, [motions[number] for number in order])
    assert_close(other, in_order, FLOAT32)


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
