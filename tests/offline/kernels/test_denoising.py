"""Sliding DCTs in windows against their reference."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.stages.denoising import cosines, denoise
from shared.arrays import BoolArray, FloatArray
from tests.reference import denoising as reference
from tests.reference.compare import assert_close

# Sums of some hundred float32 terms there and back. A coefficient within rounding of the threshold would be off by more.
FLOAT32 = 2e-5
THRESHOLD = 2.7


def scene(shape: tuple[int, int], sigma: float, seed: int = 0) -> tuple[FloatArray, BoolArray]:
    """Slanted edges and a little shading, and which samples are in doubt."""
    random = np.random.default_rng(seed)
    row, column = np.indices(shape)
    light = 0.4 + 0.8 * (row + 0.3 * column > shape[0] / 2) + 0.1 * np.sin(row / 5.0) + random.normal(0, sigma, shape)
    return light.astype(np.float32), random.random(shape) < 0.1


def denoised(noisy: FloatArray, uncertain: BoolArray, sizes: tuple[int, ...], shot: float, read: float) -> FloatArray:
    transforms = np.zeros((len(sizes), max(sizes), max(sizes)), np.float32)
    for transform, size in zip(transforms, sizes, strict=True):
        transform[:size, :size] = cosines(size)
    out = np.full_like(noisy, np.nan)
    model = np.float32(shot), np.float32(read), np.float32(THRESHOLD)
    noisy, uncertain = np.ascontiguousarray(noisy), np.ascontiguousarray(uncertain)
    denoise(noisy, uncertain, (0, len(noisy)), np.array(sizes), transforms, *model, out)
    return out


@pytest.mark.parametrize(("shot", "read"), [(0.0, 0.05), (0.002, 0.02)])
@pytest.mark.parametrize(
    ("shape", "sizes"),
    [((1, 1), (8,)), ((2, 37), (4, 8)), ((19, 23), (8, 12)), ((31, 14), (16,)), ((140, 9), (4,)), ((8, 270), (8,))],
)
def test_equals_the_reference(shape: tuple[int, int], sizes: tuple[int, ...], shot: float, read: float) -> None:
    noisy, uncertain = scene(shape, 0.05)
    expected = reference.denoise(noisy.astype(np.float64), uncertain, sizes, shot, read, THRESHOLD)
    assert_close(denoised(noisy, uncertain, sizes, shot, read), expected, FLOAT32)


def test_windows_and_threads_leave_no_trace(each_thread_count: Iterator[int]) -> None:
    noisy, uncertain = scene((300, 530), 0.05)
    whole = denoised(noisy, uncertain, (8, 12), 0.001, 0.04)
    for _ in each_thread_count:
        assert np.array_equal(denoised(noisy, uncertain, (8, 12), 0.001, 0.04), whole)
    # A window sees all that its pixels depend on: seams would show where frames of other sizes have none.
    part = denoised(noisy[:, :200], uncertain[:, :200], (8, 12), 0.001, 0.04)
    assert np.array_equal(part[:, :170], whole[:, :170])


def test_it_denoises() -> None:
    clean, _ = scene((120, 120), 0.0)
    noisy, uncertain = scene((120, 120), 0.05)
    found = denoised(noisy, uncertain, (8, 12), 0.0, 0.05)
    assert np.square(found - clean).mean() < np.square(noisy - clean).mean() / 10


def test_cosines_are_orthonormal() -> None:
    for size in (4, 8, 12):
        assert_close(cosines(size).astype(np.float64) @ cosines(size).T, np.eye(size), 1e-6)
