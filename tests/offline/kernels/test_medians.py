"""Oriented medians against their reference."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.stages.chromaticity import oriented_medians
from tests.reference import chromaticity as reference


@pytest.mark.parametrize("taps", [3, 5, 7, 9])
@pytest.mark.parametrize("shape", [(1, 1, 2), (1, 9, 3), (2, 3, 3), (17, 8, 4), (23, 41, 3)])
def test_one_step_equals_the_reference(shape: tuple[int, int, int], taps: int) -> None:
    """To the bit: medians and comparisons, no arithmetic on what is kept."""
    coarse = np.random.default_rng(taps).normal(size=shape)
    expected = np.empty_like(coarse)
    for row, column in np.ndindex(shape[:2]):
        near = reference.proposals(coarse, row, column, taps)
        expected[row, column] = near[int(np.argmin([np.sum((value - coarse[row, column]) ** 2) for value in near]))]
    assert np.array_equal(oriented_medians(coarse, taps, 1), expected)


@pytest.mark.parametrize("taps", [3, 5])
def test_only_rows_that_change_are_done_again(taps: int) -> None:
    """Going on step by step, each from scratch, is the same as all at once."""
    coarse = np.random.default_rng(4).normal(size=(31, 26, 3))
    coarse[:12] = 0.5
    step, steps = coarse, 0
    while not np.array_equal(following := oriented_medians(step, taps, 1), step):
        step, steps = following, steps + 1
    assert steps > 3
    assert np.array_equal(oriented_medians(coarse, taps, 100), step)
    assert np.array_equal(oriented_medians(coarse, taps, 2), oriented_medians(oriented_medians(coarse, taps, 1), taps, 1))
    assert np.array_equal(oriented_medians(coarse, taps, 0), coarse)


def test_threads_leave_no_trace(each_thread_count: Iterator[int]) -> None:
    coarse = np.random.default_rng(5).normal(size=(40, 33, 3))
    whole = oriented_medians(coarse, 5, 20)
    for _ in each_thread_count:
        assert np.array_equal(oriented_medians(coarse, 5, 20), whole)
