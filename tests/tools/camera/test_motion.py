"""A displaced picture is what a camera that has moved would see: compared with scenes that are known at every point."""

import numpy as np
import pytest

from shared.arrays import DoubleArray, FloatArray
from shared.motion import Motion
from tools.camera.motion import displaced, reach

SHAPE = (150, 171)
ACCURATE = 2e-3  # of waves up to 0.7 of the highest frequency, whose sum is between 0 and 2


def waves(points: DoubleArray) -> FloatArray:
    """A band-limited scene at any points (..., 2), in two channels."""
    rng = np.random.default_rng(5)
    light = np.ones((*points.shape[:-1], 2))
    for _ in range(12):
        frequency, phase = rng.uniform(-0.35, 0.35, 2), rng.uniform(0, 2 * np.pi, 2)
        light += np.cos(2 * np.pi * (points @ frequency)[..., None] + phase) / 12
    return light.astype(np.float32)


def grid(shape: tuple[int, int]) -> DoubleArray:
    return np.moveaxis(np.indices(shape, dtype=float), 0, -1)


def moved(down: float, across: float, degrees: float = 0.0) -> Motion:
    return Motion((down, across), -np.radians(degrees))


@pytest.mark.parametrize(
    "motion",
    [moved(0.5, 0), moved(0, -0.5), moved(2.3, -1.6), moved(-0.25, 3.75, 0.3), moved(1.1, 0.4, -5), moved(0, 0, 9)],
)
def test_a_displaced_scene_is_the_scene_at_the_displaced_points(motion: Motion) -> None:
    border = reach(motion, SHAPE)
    inside = (slice(border, -border), slice(border, -border))
    seen = displaced(waves(grid(SHAPE)), motion)
    # The points of the reference that the pixels of the frame see.
    down, across = np.indices(SHAPE, np.float32)
    points: DoubleArray = np.stack(motion.back(down, across, SHAPE), axis=-1).astype(np.float64)
    assert seen.dtype == np.float32
    assert np.abs(seen - waves(points))[inside].max() < ACCURATE
    assert np.abs(seen - waves(grid(SHAPE)))[inside].max() > ACCURATE


@pytest.mark.parametrize(("down", "across"), [(1, 0), (0, -3), (-17, 20)])
def test_whole_pixels_are_exact(down: int, across: int) -> None:
    light = np.random.default_rng(0).random((60, 70, 3), np.float32)
    seen = displaced(light, moved(down, across))
    border = reach(moved(down, across), light.shape)
    rolled = np.roll(light, (down, across), (0, 1))
    assert np.array_equal(seen[20:-20, 20:-20], rolled[20:-20, 20:-20])
    assert border >= max(abs(down), abs(across))


def test_beyond_the_border_the_outermost_pixels_go_on() -> None:
    flat = np.full((20, 30, 3), 0.25, np.float32)
    np.testing.assert_allclose(displaced(flat, moved(3.3, -40.1, 12)), flat, rtol=1e-6)


def test_what_is_within_reach_of_the_border_alone_depends_on_what_is_beyond() -> None:
    light = np.random.default_rng(1).random((130, 150, 1), np.float32)
    framed = np.pad(light, ((30, 30), (30, 30), (0, 0)), constant_values=9)
    for motion in (moved(1.5, 2.5), moved(-2, 0.25, 1.5)):
        border = reach(motion, light.shape)
        inside = (slice(border, -border), slice(border, -border))
        seen, other = displaced(light, motion), displaced(framed, motion)[30:-30, 30:-30]
        np.testing.assert_allclose(seen[inside], other[inside], atol=1e-5)


def test_no_motion_changes_nothing() -> None:
    light = np.random.default_rng(2).random((9, 8, 3), np.float32)
    assert displaced(light, Motion()) is light
    assert reach(Motion(), light.shape) == 0
