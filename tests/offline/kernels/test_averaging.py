"""Non-local averaging in windows against its reference."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.numerics.gaussian import gaussian
from offline.stages.refinement import average
from shared.arrays import FloatArray, mirrored
from tests.reference import refinement as reference
from tests.reference.compare import assert_close

# Sums of up to 289 float32 products of values up to four, divided by the sum of the weights, up to four times.
FLOAT32 = 5e-6


def scene(shape: tuple[int, int], channels: int, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    row, column = np.indices(shape)
    light = 0.6 + 0.4 * np.sin(row / 6.0) * np.cos(column / 9.0) + random.normal(0, 0.05, shape)
    return random.uniform(0.1, 1.0, (*shape, channels)).astype(np.float32), light.astype(np.float32)


def averaged(initial: FloatArray, light: FloatArray, radius: int, std: float, h: float, repetitions: int) -> FloatArray:
    out, blur = np.full_like(initial, np.nan), gaussian(std)
    margin = (repetitions + 1) * radius + len(blur) // 2
    down, across = (mirrored(np.arange(-margin, size + margin), size) for size in light.shape)
    average(initial, light, (down, down, across), radius, blur, -0.5 / h**2, repetitions, out)
    return out


@pytest.mark.parametrize("repetitions", [1, 2, 4])
@pytest.mark.parametrize(
    ("shape", "radius", "std", "channels"),
    [
        ((1, 1), 1, 0.375, 3),
        ((3, 40), 3, 0.75, 2),
        ((16, 17), 2, 0.5, 5),
        ((131, 283), 3, 0.75, 3),
        ((150, 270), 1, 0.1, 3),
        ((45, 300), 8, 2.0, 3),
        ((5, 5), 8, 2.0, 3),
    ],
)
def test_equals_the_reference(shape: tuple[int, int], radius: int, std: float, channels: int, repetitions: int) -> None:
    initial, light = scene(shape, channels)
    expected = reference.refine(
        initial.astype(np.float64),
        light.astype(np.float64),
        2 * radius,
        h=0.2,
        blur_periods=std / (2 * radius),
        repetitions=repetitions,
    )
    assert_close(averaged(initial, light, radius, std, 0.2, repetitions), expected, FLOAT32)


def test_threads_leave_no_trace(each_thread_count: Iterator[int]) -> None:
    initial, light = scene((301, 270), 3)
    whole = averaged(initial, light, 3, 0.75, 0.3, 3)
    for _ in each_thread_count:
        assert np.array_equal(averaged(initial, light, 3, 0.75, 0.3, 3), whole)


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_the_dark_is_left_as_it_was(value: float) -> None:
    """Where the window has no light, and only there; nearby light counts however little it resembles."""
    initial, light = scene((40, 50), 3)
    light[:, :25] = value
    expected = reference.refine(initial.astype(np.float64), light.astype(np.float64), 6, h=0.2, blur_periods=0.125, repetitions=2)
    found = averaged(initial, light, 3, 0.75, 0.2, 2)
    assert_close(found, expected, FLOAT32)
    assert np.array_equal(found[:, :22], initial[:, :22])
    # So narrow a window that no weight is left: as in exact arithmetic, where they are smaller than any number.
    found = averaged(initial, light, 3, 0.75, 1e-4, 1)
    assert np.array_equal(found[:, :25], initial[:, :25])
