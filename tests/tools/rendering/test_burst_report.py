"""Pictures of the report, and the places to look at."""

from dataclasses import replace

import numpy as np
import pytest

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from tools.rendering.burst_report import CELL, Shown, most_different


def test_the_places_are_where_pictures_differ_and_do_not_overlap() -> None:
    one, other = np.zeros((2, 500, 700, 3), np.uint8)
    other[300:310, 400:410], other[20:24, 600:604], other[480:, 0:2] = 200, 250, 90
    places = most_different(one, other, 4)
    assert len(places) == 3
    for row, column in [(305, 405), (22, 602), (490, 1)]:
        assert any(top <= row < top + CELL and left <= column < left + CELL for top, left in places)
    assert all(abs(a[0] - b[0]) >= CELL or abs(a[1] - b[1]) >= CELL for a in places for b in places if a is not b)
    assert all(top + CELL <= 500 and left + CELL <= 700 for top, left in places)


def test_pictures_smaller_than_a_place() -> None:
    one, other = np.zeros((2, 30, 200, 3), np.uint8)
    assert most_different(one, other, 4) == []
    other[5, 190] = 1
    assert most_different(one, other, 4) == [(0, 96)]


@pytest.mark.parametrize("orientation", [1, 6])
def test_bands_pass_and_the_picture_is_upright(orientation: int) -> None:
    mosaic = Mosaic(np.full((30, 40), 0.5, np.float32), CfaPattern.bayer(), SensorCalibration())
    shown = Shown(replace(mosaic, metadata=CaptureMetadata(orientation=orientation)), 0.0)
    rgb = np.random.default_rng(0).random((30, 40, 3), np.float32)
    passed = list(shown.taken([rgb[:20], rgb[20:]]))
    assert [len(band) for band in passed] == [20, 10]
    assert shown.picture.shape == ((30, 40, 3) if orientation == 1 else (40, 30, 3))
    first = shown.picture[0, 0] if orientation == 1 else shown.picture[0, -1]  # turned clockwise
    assert np.array_equal(np.argsort(first), np.argsort(rgb[0, 0]))
