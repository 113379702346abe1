"""Interpolation between blocks and raising of clipped samples, against the literal definitions."""

from collections.abc import Iterator

import numpy as np

from offline.blocks import tile
from offline.numerics.interpolation import interpolate
from offline.stages.highlights import raise_clipped
from shared import CfaPattern
from tests.offline.scenes import every_case
from tests.reference import highlights as reference
from tests.reference.compare import assert_close
from tests.reference.geometry import keys

ROUNDING = 1e-5  # float32 values of size one
CLIPPING, APART, FAINT = 0.7, 0.4, 0.05
FALL = np.exp(-(np.arange(4.0) ** 2) / 4)


@every_case
def test_interpolation_is_cubic_convolution(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    values = np.random.default_rng(1).uniform(size=(3, 4)).astype(np.float32)
    first = 1.5, 4.0
    found = np.empty(shape, np.float32)
    interpolate(values, first, pattern.period, found)
    expected = [
        keys(values.astype(np.float64), (row - first[0]) / pattern.period, (column - first[1]) / pattern.period)
        for row, column in np.ndindex(shape)
    ]
    assert_close(found, np.reshape(expected, shape), ROUNDING)


@every_case
def test_raised_samples_are_those_of_the_definition(
    pattern: CfaPattern, shape: tuple[int, int], each_thread_count: Iterator[int]
) -> None:
    signal, plane = np.random.default_rng(2).uniform(size=(2, *shape)).astype(np.float32)
    plane += np.float32(0.3)
    panchromatic = tile(pattern)
    results = []
    for _ in each_thread_count:
        result = signal.copy()
        raise_clipped(signal, panchromatic, CLIPPING, APART, plane, FALL, FAINT, result)
        results.append(result)
    expected = [reference.raised(signal, pattern, CLIPPING, APART, plane, FALL, FAINT, place) for place in np.ndindex(shape)]
    assert_close(results[0], np.reshape(expected, shape), ROUNDING)
    assert len({result.tobytes() for result in results}) == 1
