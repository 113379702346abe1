"""Filling block by block is filling the plane, where blocks are alone."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.stages import luminance as product
from offline.stages.luminance import LuminanceSettings, fill, recover_luminance
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import DoubleArray, FloatArray
from tests.offline.kernels.patterns import frames
from tests.reference import luminance as reference
from tests.reference.compare import assert_close

# As in tests/offline/test_luminance.py: fifty rounds in float32 at values up to four.
FLOAT32 = 5e-5
SETTINGS = LuminanceSettings()
THRESHOLDS = (SETTINGS.threshold * SETTINGS.decay ** np.arange(SETTINGS.iterations)).astype(np.float32)


def mosaic_of(pattern: CfaPattern, shape: tuple[int, int], scale: float = 1.0, seed: int = 0) -> Mosaic:
    samples = scale * np.random.default_rng(seed).normal(0.8, 0.3, size=shape)
    return Mosaic(samples.astype(np.float32), pattern, SensorCalibration(pattern.channels))


def start_of(mosaic: Mosaic) -> DoubleArray:
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    return reference.start(mosaic.signal.astype(np.float64), measured, around=len(mosaic.pattern.sites) > 4)


def whole_plane(mosaic: Mosaic) -> FloatArray:
    holes = mosaic.pattern.filter_map(mosaic.shape) < len(mosaic.pattern.channels)
    return fill(start_of(mosaic).astype(np.float32), holes, THRESHOLDS)[0]


@pytest.mark.parametrize(("pattern", "shape"), frames(18, 330, seed=1))
def test_equals_the_whole_plane(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = mosaic_of(pattern, shape)
    assert_close(recover_luminance(mosaic, SETTINGS), whole_plane(mosaic).astype(np.float64), FLOAT32)


@pytest.mark.parametrize(("pattern", "shape"), frames(12, 100, seed=2))
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = mosaic_of(pattern, shape)
    measured = pattern.panchromatic_mask(shape)
    expected = reference.recover(start_of(mosaic), measured, 50, SETTINGS.decay, SETTINGS.threshold)
    assert_close(recover_luminance(mosaic, SETTINGS), expected, FLOAT32)


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e-3, 1e6])
@pytest.mark.parametrize("period", [4, 6])
def test_equals_the_reference_at_extreme_values(period: int, scale: float) -> None:
    pattern = CfaPattern.bayer(period, origin=(1, 3))
    mosaic = mosaic_of(pattern, (41, 64), scale)
    threshold = reference.first_threshold(mosaic.signal.astype(np.float64), 1.0)
    expected = reference.recover(start_of(mosaic), pattern.panchromatic_mask(mosaic.shape), 50, 2**-0.25, threshold)
    assert_close(recover_luminance(mosaic, SETTINGS), expected, FLOAT32 * max(1.0, scale))


def test_the_fast_path_is_taken() -> None:
    """Where blocks are alone: from period 6 for 2 x 2 of them, except next to the frame's edge."""
    assert len(product._isolated(CfaPattern.bayer(5), (100, 100), 0)) == 0
    assert product._isolated(CfaPattern.bayer(6, origin=(3, 0)), (24, 24), 0).tolist() == [9, 15]
    assert product._isolated(CfaPattern.bayer(6, origin=(4, 0)), (34, 34), 0).tolist() == [4, 10, 16, 22, 28]
    assert len(product._isolated(CfaPattern.with_block(("RGB", "XWY"), 6), (60, 60), 1)) == 0
    assert len(product._isolated(CfaPattern.with_block(("RGB", "XWY"), 7), (60, 60), 1)) > 0


@pytest.mark.parametrize("period", [4, 6, 8])
def test_threads_and_pieces_leave_no_trace(monkeypatch: pytest.MonkeyPatch, period: int, each_thread_count: Iterator[int]) -> None:
    mosaic = mosaic_of(CfaPattern.bayer(period, origin=(2, 1)), (163, 201))
    whole = recover_luminance(mosaic, SETTINGS)
    monkeypatch.setattr(product, "_PIECE", 3)
    for _ in each_thread_count:
        assert np.array_equal(recover_luminance(mosaic, SETTINGS), whole)
