"""Non-local means of luminance in windows against their reference."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.kernels.similar import AREA, SURROUNDINGS, average_similar
from shared.arrays import BoolArray, FloatArray
from tests.reference import denoising as reference
from tests.reference.compare import assert_close

# Sums of up to 289 float32 products, divided by the sum of the weights.
FLOAT32 = 5e-6
SHARE, SIMILARITY = 0.6, 0.7


def scene(shape: tuple[int, int]) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Waves with noise, without it, and which samples are in doubt."""
    random = np.random.default_rng(0)
    row, column = np.indices(shape)
    clean = 0.6 + 0.4 * np.sin(row / 6.0) * np.cos(column / 9.0) + random.normal(0, 0.02, shape)
    return (clean + random.normal(0, 0.05, shape)).astype(np.float32), clean.astype(np.float32), random.random(shape) < 0.1


def averaged(planes: tuple[FloatArray, FloatArray, BoolArray], radius: int, shot: float, read: float) -> FloatArray:
    noisy, clean, uncertain = planes
    return rows_of(noisy, clean, 0, uncertain, (0, len(noisy)), radius, shot, read)


def rows_of(
    noisy: FloatArray,
    clean: FloatArray,
    first: int,
    uncertain: BoolArray,
    rows: tuple[int, int],
    radius: int,
    shot: float,
    read: float,
) -> FloatArray:
    out = np.full((rows[1] - rows[0], noisy.shape[1]), np.nan, np.float32)
    model = np.float32(shot), np.float32(read)
    shares = np.full([-(-size // side) for size, side in zip(noisy.shape, AREA, strict=True)], SHARE)
    shares[1:, 1:] = 0  # in a large frame
    average_similar(noisy, uncertain, clean, first, rows, radius, *model, np.float32(SIMILARITY), shares.astype(np.float32), out)
    return out


@pytest.mark.parametrize(("shot", "read"), [(0.0, 0.05), (0.002, 0.02)])
@pytest.mark.parametrize(("shape", "radius"), [((1, 1), 1), ((2, 40), 3), ((31, 14), 8), ((140, 30), 2), ((20, 270), 7)])
def test_equals_the_reference(shape: tuple[int, int], radius: int, shot: float, read: float) -> None:
    noisy, clean, uncertain = planes = scene(shape)
    exact = clean.astype(np.float64)
    samples = np.where(uncertain, exact, noisy)
    expected = (1 - SHARE) * exact + SHARE * reference.similar_mean(samples, exact, shot, read, SIMILARITY, radius)
    assert_close(averaged(planes, radius, shot, read), expected, FLOAT32)


def test_rows_and_threads_leave_no_trace(each_thread_count: Iterator[int]) -> None:
    noisy, clean, uncertain = planes = scene((300, 530))
    whole = averaged(planes, 5, 0.001, 0.04)
    assert np.array_equal(whole != clean, ~((np.arange(300)[:, None] >= AREA[0]) & (np.arange(530) >= AREA[1])))
    for _ in each_thread_count:
        assert np.array_equal(averaged(planes, 5, 0.001, 0.04), whole)
    for top, bottom in ((0, 37), (100, 101), (143, 300), (290, 300)):
        first, last = max(top - 5 - SURROUNDINGS, 0), min(bottom + 5 + SURROUNDINGS, 300)
        found = rows_of(noisy, clean[first:last], first, uncertain, (top, bottom), 5, 0.001, 0.04)
        assert np.array_equal(found, whole[top:bottom])


def test_hardly_any_shot_noise_is_as_none() -> None:
    """The transform that evens noise out subtracts nothing large from something as large."""
    planes = scene((40, 60))
    assert_close(averaged(planes, 4, 1e-9, 0.05), averaged(planes, 4, 0.0, 0.05).astype(np.float64), FLOAT32)


def test_without_read_noise_black_is_a_signal_like_any_other() -> None:
    noisy, clean, uncertain = scene((30, 40))
    clean[:, :20], clean[:10] = 0, -0.1
    exact = clean.astype(np.float64)
    samples = np.where(uncertain, exact, noisy)
    expected = (1 - SHARE) * exact + SHARE * reference.similar_mean(samples, exact, 0.002, 0.0, SIMILARITY, 3)
    assert_close(averaged((noisy, clean, uncertain), 3, 0.002, 0.0), expected, FLOAT32)
