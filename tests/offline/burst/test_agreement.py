"""How far frames agree, against a literal transcription."""

import numpy as np
import pytest

from offline.burst.agreement import _compared, agreement
from shared import NoiseModel
from tests.reference import agreement as reference

FLOAT32 = 2e-3  # relative: differences of squares that are nearly equal


@pytest.mark.parametrize("noise", [((0.0, 0.0), (0.0, 0.0)), ((1e-3, 4e-4), (2e-3, 9e-4))])
def test_equals_the_transcription(noise: tuple[tuple[float, float], tuple[float, float]]) -> None:
    random = np.random.default_rng(0)
    y, x = np.indices((60, 90))
    planes = [1 + 0.4 * np.sin((y + shift) / 3) * np.cos(x / 4) + random.normal(0, 0.02, y.shape) for shift in (0.0, 0.3)]
    planes[1][20:35, 40:60] += 0.15
    planes[1][45:50] = planes[0][45:50]
    weight = random.uniform(0.1, 1, y.shape)
    models = tuple(NoiseModel((shot,) * 4, (read**0.5,) * 4) if read else None for shot, read in noise)
    first, second, weights = (plane.astype(np.float32) for plane in (*planes, weight))
    found = _compared(first, second, weights, (models[0], models[1]))
    exact = [plane.astype(np.float64) for plane in (first, second, weights)]
    expected = reference.compared(exact[0], exact[1], exact[2], noise)
    assert np.abs(found - expected).max() <= FLOAT32 * expected.max()
    assert np.median(np.abs(found / expected - 1)) < FLOAT32


def test_strips_leave_no_trace() -> None:
    random = np.random.default_rng(1)
    planes = [random.uniform(0.5, 1.5, (600, 40)).astype(np.float32) for _ in range(3)]
    whole = agreement(planes[0], planes[1], planes[2], (None, None), (np.inf, np.inf))
    below = [np.ascontiguousarray(plane[256:]) for plane in planes]
    lower = agreement(below[0], below[1], below[2], (None, None), (np.inf, np.inf))
    assert np.array_equal(lower[40:], whole[296:])
