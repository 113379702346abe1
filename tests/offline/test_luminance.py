"""Hole filling against its reference, and against what Eqs. 1-5 promise."""

import numpy as np
import pytest

from panchroma.offline.settings import UNLEARNED
from panchroma.offline.stages.luminance import LuminanceSettings, recover_luminance
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray
from tests.offline.scenes import CASES, every_case, shot
from tests.reference import luminance as reference
from tests.reference.compare import assert_close

# Fifty rounds in float32 at values up to four: some twenty operations a round, half a unit in the
# last place (2e-7) each, and the shrinkage passes errors on about as they are.
FLOAT32 = 5e-5
# Fifty rounds with a falling threshold stop near the minimum of Eq. 1, not in it: as a part of the
# objective.
SETTLED = 1e-4

PAPER = LuminanceSettings()


def expected(mosaic: Mosaic, settings: LuminanceSettings = PAPER) -> DoubleArray:
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    signal = mosaic.signal.astype(np.float64)
    around = settings.relative or len(mosaic.pattern.sites) > 4
    start = reference.start(signal, measured, around=around)
    threshold = reference.first_threshold(signal, settings.threshold, relative=settings.relative)
    return reference.recover(start, measured, settings.iterations, settings.decay, threshold)


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


@pytest.mark.parametrize("width", [31, 50, 88, 101, 115, 136])
@pytest.mark.parametrize("period", [3, 5, 6, 7, 8])
def test_equals_the_reference_wherever_the_last_block_lies(period: int, width: int) -> None:
    pattern = CfaPattern.bayer(period, origin=(width % period, width % 3))
    mosaic = shot(pattern, (3 * period + width % 5, width))
    assert_close(recover_luminance(mosaic, PAPER), expected(mosaic), FLOAT32)


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e-3, -1.0, 1e6])
@pytest.mark.parametrize("period", [4, 6])
def test_equals_the_reference_at_extreme_values(period: int, scale: float) -> None:
    samples = scale * np.random.default_rng(3).normal(size=(19, 38))
    pattern = CfaPattern.bayer(period, origin=(1, 2))
    mosaic = Mosaic(samples.astype(np.float32), pattern, SensorCalibration())
    assert_close(recover_luminance(mosaic, PAPER), expected(mosaic), FLOAT32 * max(1.0, scale))


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
