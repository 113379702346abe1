"""The pictures that explain: their panels show what they say."""

import numpy as np
from PIL import Image

from panchroma.shared import ByteArray, CfaPattern, FloatArray, SensorCalibration
from panchroma.tools.io import illustrations
from panchroma.tools.io.illustrations import comparison, overview
from panchroma.tools.simulation.sensor import simulate_additive

PANEL, GAP, CAPTION = illustrations._PANEL, illustrations._GAP, illustrations._CAPTION


def panel(sheet: Image.Image, row: int, column: int) -> ByteArray:
    """The pixels of one panel, without its caption."""
    top, left = GAP + row * (PANEL + CAPTION + GAP), GAP + column * (PANEL + GAP)
    return np.asarray(sheet)[top : top + PANEL, left : left + PANEL]


def test_the_overview_draws_both_patterns_and_shows_holes_where_the_colour_is() -> None:
    rgb: FloatArray = np.full((80, 90, 3), 0.2, np.float32)
    rgb[30:60, 30:60] = 0.6, 0.2, 0.1
    sensor, rng = (CfaPattern.bayer(6), SensorCalibration()), np.random.default_rng(0)
    mosaic = simulate_additive(rgb, *sensor, 0.0, rng)
    # of a perfect render; a block begins at the corner
    sheet = overview(mosaic, rgb.sum(axis=2), rgb, (12, 12))
    cell = PANEL // 12
    middles = slice((PANEL - 12 * cell + cell) // 2, 12 * cell, cell)
    names = {colour: letter for letter, colour in illustrations._FILTERS.items()}
    for column, tile in enumerate((["RG" * 3, "GB" * 3] * 3, CfaPattern.bayer(6).tile)):
        drawn = panel(sheet, 0, column)[middles, middles].tolist()
        letters = ["".join(names[tuple(pixel)] for pixel in row) for row in drawn]
        assert letters == [row * 2 for row in tile] * 2
    factor = PANEL // illustrations._PANEL_PIXELS
    places = ((0, 2), (1, 0), (1, 1))
    samples, colours, filled = (
        panel(sheet, *place)[factor // 2 :: factor, factor // 2 :: factor].astype(int)
        for place in places
    )
    # one channel is darker than the sum of three
    assert samples[0, 0].max() < samples[3, 3].min() - 20
    assert np.ptp(filled[:4, :4].max(axis=2)) <= 2  # and the hole is filled
    assert [colours[place].argmax() for place in ((0, 0), (0, 1), (1, 1))] == [0, 1, 2]
    assert (colours[3, 3] == colours[4, 4]).all()  # nothing there


def test_the_comparison_has_a_row_per_crop_and_a_column_per_picture() -> None:
    ramp: FloatArray = np.linspace(0, 1, 100 * 120 * 3, dtype=np.float32).reshape(100, 120, 3)
    pictures = {"one": ramp, "other": 1 - ramp, "third": ramp * 0.5}
    crops = {"here": (3, 5), "there": (30, 50)}
    sheet = comparison(pictures, crops, size=33)
    assert sheet.size == (3 * (PANEL + GAP) + GAP, 2 * (PANEL + CAPTION + GAP) + GAP)
    for row, (top, left) in enumerate(crops.values()):
        for column, picture in enumerate(pictures.values()):
            shown = panel(sheet, row, column)[5::10, 5::10] / 255
            crop = picture[top : top + 33, left : left + 33]
            np.testing.assert_allclose(shown, crop, atol=0.5 / 255 + 1e-6)
