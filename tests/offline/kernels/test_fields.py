"""Fields of many regions against those of the whole frame."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.stages import affinity as product
from offline.stages.affinity import AffinitySettings, solve_affinities
from offline.tiling import bands, core_patches
from shared import CfaPattern
from shared.arrays import FloatArray
from tests.offline.kernels.patterns import frames
from tests.reference import affinity as reference
from tests.reference.compare import assert_close

TIGHT = AffinitySettings(tolerance=1e-6)
# What a halo of two patches leaves at most, for periods up to 8. The solver's tolerance of 1e-3 leaves 0.1 and 1e-3.
CUT, CUT_RMS = 0.01, 5e-4
SUM = 5e-7


def light_of(shape: tuple[int, int], seed: int = 0) -> FloatArray:
    """Shading, steps and noise."""
    random = np.random.default_rng(seed)
    row, column = np.indices(shape)
    steps = 0.4 * (np.sin(row / 9.0 + seed) * np.cos(column / 13.0) > 0.2)
    return (0.5 + steps + 0.1 * np.sin(row / 31.0) + random.normal(0, 0.02, shape)).astype(np.float32)


def compare(light: FloatArray, pattern: CfaPattern) -> None:
    found = solve_affinities(light, pattern, TIGHT)
    expected = reference.fields(light.astype(np.float64), pattern, TIGHT.scales)
    assert_close(found, expected, CUT)
    assert np.sqrt(np.mean((found - expected) ** 2)) < CUT_RMS


@pytest.mark.parametrize(("pattern", "shape"), frames(6, 150, seed=3))
def test_small_regions_equal_the_whole_frame(pattern: CfaPattern, shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Cores of three patches: nine times as many borders as there will ever be."""
    light = light_of(shape)
    monkeypatch.setattr(product, "core_patches", lambda _: (3, 3))
    compare(light, pattern)


@pytest.mark.parametrize(("period", "shape"), [(6, (139, 131)), (8, (91, 290))])
def test_regions_equal_the_whole_frame(period: int, shape: tuple[int, int]) -> None:
    light = light_of(shape, seed=1)
    pattern = CfaPattern.bayer(period, origin=(2, 3))
    down, across = pattern.grid(shape).patches
    assert down > core_patches(period)[0] or across > core_patches(period)[1]
    compare(light, pattern)


@pytest.mark.parametrize("period", [3, 6])
def test_rows_of_patches_and_threads_leave_no_trace(period: int, each_thread_count: Iterator[int]) -> None:
    pattern, shape = CfaPattern.bayer(period, origin=(1, 1)), (331, 205)
    light = light_of(shape)
    entire = solve_affinities(light, pattern, AffinitySettings())
    steps = bands(pattern.grid(shape))
    assert len(steps) > 1
    for _ in each_thread_count:
        parts = [solve_affinities(light, pattern, AffinitySettings(), rows) for rows in steps]
        assert np.array_equal(np.concatenate(parts, axis=2), entire)
    assert_close(entire.sum(axis=(0, 1)), np.ones(entire.shape[2:]), SUM)
