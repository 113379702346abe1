"""Outliers and what replaces them, against the literal definitions, and the same bytes from any number of threads."""

from collections.abc import Iterator

import numpy as np
import pytest

from offline.blocks import tile
from offline.stages.defects import find_outliers, mend_panchromatic
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import BoolArray, FloatArray
from tests.offline.scenes import cleaned, every_case, gamma_of
from tests.reference import geometry
from tests.reference import outliers as reference
from tests.reference.compare import assert_close

LIMITS = (1.5, 2.0, 0.01)  # contrast low enough that a random picture has outliers of every kind
NOISE = (0.01, 0.02)
ROUNDING = 1e-5  # float32 samples of size one in weighted means


def speckled(shape: tuple[int, int], seed: int = 0) -> tuple[FloatArray, BoolArray]:
    random = np.random.default_rng(seed)
    signal = random.uniform(0.4, 0.6, shape)
    signal[random.random(shape) < 0.06] = 2.0
    signal[random.random(shape) < 0.06] = -0.3
    return signal.astype(np.float32), random.random(shape) < 0.15


@every_case
def test_outliers_are_those_of_the_definition(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    signal, bad = speckled(shape)
    gamma = gamma_of(pattern)
    expected = np.array([reference.stands_out(signal, pattern, bad, gamma, place, *LIMITS, NOISE) for place in np.ndindex(shape)])
    found = np.zeros_like(bad)
    find_outliers(signal, _gains(pattern), *LIMITS, NOISE, bad, found)
    assert np.array_equal(bad | found, bad | expected.reshape(shape))


def test_the_definition_sees_outliers_up_and_down() -> None:
    signal, bad = speckled((40, 40))
    pattern = CfaPattern.bayer()
    gamma = gamma_of(pattern)
    found = [
        place for place in np.ndindex(signal.shape) if reference.stands_out(signal, pattern, bad, gamma, place, *LIMITS, NOISE)
    ]
    assert {bool(signal[place] > 1) for place in found} == {True, False}


@every_case
def test_replacements_are_those_of_the_definition(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    signal, bad = speckled(shape)
    bad[: shape[0] // 2, : shape[1] // 2] = True  # more than eight pixels to the nearest good one, in the larger frames
    rows, columns = np.nonzero(bad)
    found = np.empty(rows.size, np.float32)
    mend_panchromatic(signal, tile(pattern), bad, rows, columns, found)
    expected = np.array([reference.replacement(signal, pattern, bad, *place) for place in np.argwhere(bad).tolist()])
    assert_close(found, expected, ROUNDING)


@every_case
def test_surroundings_are_weighted_by_distance(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    signal, _ = speckled(shape)
    frame = cleaned(Mosaic(signal, pattern, SensorCalibration(pattern.channels)))
    (light, lowest, highest), (rows, columns) = frame.around, frame.sites.pixels
    block = geometry.block(pattern)
    for i, j in np.ndindex(frame.sites.shape):
        top, left = int(frame.sites.grid.whole_rows[i]), int(frame.sites.grid.whole_columns[j])
        area = np.ndindex(block.height + 2, block.width + 2)
        places = [(top + y - 1, left + x - 1) for y, x in area]
        inside = [place for place in places if 0 <= place[0] < shape[0] and 0 <= place[1] < shape[1]]
        ring = [place for place in inside if geometry.letter(pattern, *place) == "W"]
        assert lowest[i, j] == min(signal[place] for place in ring)
        assert highest[i, j] == max(signal[place] for place in ring)
        for site, channel in enumerate(frame.sites.channels):
            row, column = int(rows[i, j, site]), int(columns[i, j, site])
            assert geometry.letter(pattern, row, column) == pattern.channels[channel]
            assert frame.samples[i, j, site] == signal[row, column]
            weights = [1 / ((y - row) ** 2 + (x - column) ** 2) for y, x in ring]
            expected = np.dot(weights, [signal[place] for place in ring]) / sum(weights)
            assert light[i, j, site] == pytest.approx(expected, abs=ROUNDING)


def test_threads_leave_no_trace(each_thread_count: Iterator[int]) -> None:
    signal, bad = speckled((50, 61))
    pattern = CfaPattern.bayer()
    rows, columns = np.nonzero(bad)
    results = []
    for _ in each_thread_count:
        found, values = np.zeros_like(bad), np.empty(len(rows), np.float32)
        find_outliers(signal, _gains(pattern), *LIMITS, NOISE, bad, found)
        mend_panchromatic(signal, tile(pattern), bad, rows, columns, values)
        results.append((found.tobytes(), values.tobytes()))
    assert len(set(results)) == 1


def _gains(pattern: CfaPattern) -> FloatArray:
    return np.array((*gamma_of(pattern), 0), np.float32)[pattern.filter_map((pattern.period, pattern.period))]
