"""Hole filling against its reference, and against what Eqs. 1-5 promise."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from panchroma.offline.settings import UNLEARNED
from panchroma.offline.stages import luminance as product
from panchroma.offline.stages.luminance import LuminanceSettings, fill, recover_luminance
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.kernels.patterns import frames
from tests.offline.scenes import CASES, every_case, materials, shot
from tests.offline.stage_tests import StageTests
from tests.reference import luminance as reference
from tests.reference.compare import assert_close

# Fifty rounds in float32 at values up to four: some twenty operations a round, half a unit in the
# last place (2e-7) each, and the shrinkage passes errors on about as they are.
FLOAT32 = 5e-5
# A transform and back in float32, values of about one.
ROUND_TRIP = 1e-6
# Fifty rounds with a falling threshold stop near the minimum of Eq. 1, not in it: as a part of the
# objective.
SETTLED = 1e-4

PAPER = LuminanceSettings()


class TestLuminance(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        return recover_luminance(mosaic, self.settings.luminance)


def shrink(picture: FloatArray, threshold: float) -> FloatArray:
    """One iteration with holes everywhere: l*_t of Eq. 4."""
    return fill(picture, np.ones_like(picture, bool), np.array([threshold], np.float32))


def expected(mosaic: Mosaic, settings: LuminanceSettings = PAPER) -> DoubleArray:
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    signal = mosaic.signal.astype(np.float64)
    start = reference.start(
        signal, measured, around=settings.relative or len(mosaic.pattern.sites) > 4
    )
    threshold = reference.first_threshold(signal, settings.threshold, relative=settings.relative)
    return reference.recover(start, measured, settings.iterations, settings.decay, threshold)


def panchromatic(samples: DoubleArray, pattern: CfaPattern) -> Mosaic:
    return Mosaic(samples.astype(np.float32), pattern, SensorCalibration(pattern.channels))


@every_case
@pytest.mark.parametrize("settings", [PAPER, UNLEARNED.luminance])
@pytest.mark.parametrize("sigma", [None, 0.3])
def test_equals_the_reference(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None, settings: LuminanceSettings
) -> None:
    mosaic = shot(pattern, shape, sigma)
    found = recover_luminance(mosaic, settings)
    assert found.dtype == np.float32
    assert_close(found, expected(mosaic, settings), FLOAT32)


@pytest.mark.parametrize(
    "settings",
    [
        LuminanceSettings(1),
        LuminanceSettings(7, 0.5),
        LuminanceSettings(20, 0.95, 0.1),
        LuminanceSettings(5, 0.9, 40.0),
    ],
)
def test_equals_the_reference_at_other_settings(settings: LuminanceSettings) -> None:
    mosaic = shot(*CASES["odd"])
    assert_close(recover_luminance(mosaic, settings), expected(mosaic, settings), FLOAT32)


@pytest.mark.parametrize("side", range(36, 54))
def test_equals_the_reference_wherever_the_last_block_lies(side: int) -> None:
    mosaic = shot(CfaPattern.bayer(6), (side, 89 - side))
    assert_close(recover_luminance(mosaic, PAPER), expected(mosaic), FLOAT32)


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e-3, -1.0, 1e6])
@pytest.mark.parametrize("period", [4, 6])
def test_equals_the_reference_at_extreme_values(period: int, scale: float) -> None:
    mosaic = panchromatic(
        scale * np.random.default_rng(3).normal(size=(19, 38)),
        CfaPattern.bayer(period, origin=(1, 2)),
    )
    assert_close(recover_luminance(mosaic, PAPER), expected(mosaic), FLOAT32 * max(1.0, scale))


@pytest.mark.parametrize(("pattern", "shape"), frames(18, 330, seed=1))
def test_isolated_blocks_are_filled_as_the_whole_plane_would_be(
    pattern: CfaPattern, shape: tuple[int, int]
) -> None:
    mosaic = panchromatic(np.random.default_rng(0).normal(0.8, 0.3, size=shape), pattern)
    mask = pattern.panchromatic_mask(shape)
    start = reference.start(
        mosaic.signal.astype(np.float64), mask, around=len(pattern.sites) > 4
    ).astype(np.float32)
    thresholds = (PAPER.threshold * PAPER.decay ** np.arange(PAPER.iterations)).astype(np.float32)
    assert_close(
        recover_luminance(mosaic, PAPER),
        fill(start, ~mask, thresholds).astype(np.float64),
        FLOAT32,
    )


@pytest.mark.parametrize("period", [4, 6, 8])
def test_threads_and_chunks_leave_no_trace(
    monkeypatch: pytest.MonkeyPatch, period: int, each_thread_count: Iterator[int]
) -> None:
    mosaic = panchromatic(
        np.random.default_rng(0).normal(0.8, 0.3, size=(163, 201)),
        CfaPattern.bayer(period, origin=(2, 1)),
    )
    whole = recover_luminance(mosaic, PAPER)
    monkeypatch.setattr(product, "_ROWS", 3)
    for _ in each_thread_count:
        assert np.array_equal(recover_luminance(mosaic, PAPER), whole)


@every_case
def test_measured_samples_are_kept_to_the_bit(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = shot(pattern, shape)
    measured = pattern.panchromatic_mask(shape)
    assert np.array_equal(recover_luminance(mosaic, PAPER)[measured], mosaic.signal[measured])


@pytest.mark.parametrize("shape", [(1, 5), (2, 2), (5, 4), (16, 33)])
def test_synthesis_undoes_analysis(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(4).uniform(size=shape).astype(np.float32)
    assert_close(shrink(picture, 0.0), picture, ROUND_TRIP)


def test_shrinking_everything_leaves_the_low_pass() -> None:
    picture = np.random.default_rng(4).uniform(size=(9, 11)).astype(np.float32)
    low, *_ = reference.analyse(picture.astype(np.float64))
    others = [np.zeros_like(low[1:-1, 1:-1])] * 3
    assert_close(shrink(picture, 1e6), reference.synthesise([low[1:-1, 1:-1], *others]), ROUND_TRIP)


@pytest.mark.parametrize("case", ["paper", "odd", "period 8"])
def test_the_objective_falls(case: str) -> None:
    mosaic = shot(*CASES[case], sigma=None)
    stages = [mosaic.signal] + [
        recover_luminance(mosaic, LuminanceSettings(count)) for count in (5, 15, 30, 50)
    ]
    values = [reference.objective(stage.astype(np.float64)) for stage in stages]
    assert all(after < before * (1 + SETTLED) for before, after in pairwise(values)), values
    assert values[-1] < 0.75 * values[0]


@pytest.mark.parametrize("case", ["paper", "odd", "period 8"])
def test_the_objective_is_about_as_low_as_the_holes_allow(case: str) -> None:
    """Moving one filled pixel up or down makes it no better."""
    mosaic = shot(*CASES[case], sigma=None)
    found = recover_luminance(mosaic, PAPER).astype(np.float64)
    lowest = reference.objective(found)
    for row, column in np.argwhere(~mosaic.pattern.panchromatic_mask(mosaic.shape)):
        for step in (-0.1, -0.01, 0.01, 0.1):
            moved = found.copy()
            moved[row, column] += step
            assert reference.objective(moved) > lowest * (1 - SETTLED)


@every_case
def test_a_flat_frame_is_filled_flat(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    """Whatever the colour samples read; what is left is of the size of the last threshold."""
    samples = np.where(pattern.panchromatic_mask(shape), 1.5, 0.2)
    found = recover_luminance(panchromatic(samples, pattern), PAPER)
    assert_close(found, np.full(shape, 1.5), PAPER.threshold * PAPER.decay**49)


def test_an_inclined_plane_is_filled_as_one() -> None:
    """db2 has two vanishing moments: a plane has no high-pass coefficients, away from the mirrored
    border.
    """
    pattern = CfaPattern.bayer(6, origin=(2, 2))
    row, column = np.indices((36, 36))
    plane = 0.5 + 0.01 * row + 0.02 * column
    found = recover_luminance(
        panchromatic(np.where(pattern.panchromatic_mask((36, 36)), plane, 0.1), pattern), PAPER
    )
    inner = slice(7, -7), slice(7, -7)
    assert_close(found[inner], plane[inner], PAPER.threshold * PAPER.decay**49)


def test_values_of_colour_samples_hardly_matter_in_the_end() -> None:
    """They are only the start, l_0 = m."""
    pattern, shape = CASES["paper"]
    light = materials(shape, 3).sum(axis=-1)
    mask = pattern.panchromatic_mask(shape)
    low, high = (
        recover_luminance(panchromatic(np.where(mask, light, fill), pattern), PAPER)
        for fill in (0.0, 2.0)
    )
    assert np.abs(low - high).mean() < 0.01
    assert np.abs(low - high).max() < 0.2
