"""Hole filling against its reference, and against what Eqs. 1-5 promise."""

from collections.abc import Iterator

import numpy as np
import pytest

from panchroma.offline.settings import UNLEARNED
from panchroma.offline.stages import luminance as product
from panchroma.offline.stages.luminance import LuminanceSettings, fill, recover_luminance
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.kernels.patterns import frames
from tests.offline.scenes import CASES, every_case, shot
from tests.offline.stage_tests import StageTests
from tests.reference import luminance as reference
from tests.reference.compare import assert_close

# Fifty rounds in float32 at values up to four: some twenty operations a round, half a unit in the
# last place (2e-7) each, and the shrinkage passes errors on about as they are.
FLOAT32 = 5e-5
# Fifty rounds with a falling threshold stop near the minimum of Eq. 1, not in it: as a part of the
# objective.
SETTLED = 1e-4

PAPER = LuminanceSettings()


class TestLuminance(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        return recover_luminance(mosaic, self.settings.luminance)


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
