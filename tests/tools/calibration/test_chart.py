"""The chart: where it is found, and the colours that its patches tell."""

from collections.abc import Callable

import numpy as np
import pytest

from panchroma.shared import FloatArray, InputError, Mosaic
from panchroma.shared.colorimetry import D50, Matrix, as_rows
from panchroma.tools.calibration.chart.find import chart_at, find_chart
from panchroma.tools.calibration.chart.place import ChartPlace, least_pitch
from panchroma.tools.calibration.colour_matrix import UNEVEN, fit_colour, grey_row_fault
from panchroma.tools.calibration.places import patch_samples
from panchroma.tools.io.colour import delta_e_2000, lab_slopes, lab_to_xyz, xyz_to_lab
from panchroma.tools.simulation.perspective import rectangle
from tests.tools.calibration.known_camera import (
    HEIGHT,
    REFERENCE,
    WIDTH,
    chart,
    frame,
    shot_of,
    true_place,
)

# G. Sharma, W. Wu, E. N. Dalal (2005), table 1: L*, a*, b* of two colours and their CIEDE2000.
# Those kept are the ones at the turns of hue, near grey, far apart, and a few of the small ones.
SHARMA = np.array([
    (50, 2.6772, -79.7751, 50, 0, -82.7485, 2.0425), (50, -1.3802, -84.2814, 50, 0, -82.7485, 1.0000),
    (50, 0, 0, 50, -1, 2, 2.3669), (50, 2.4900, -0.0010, 50, -2.4900, 0.0009, 7.1792),
    (50, 2.4900, -0.0010, 50, -2.4900, 0.0011, 7.2195), (50, -0.0010, 2.4900, 50, 0.0010, -2.4900, 4.8045),
    (50, -0.0010, 2.4900, 50, 0.0011, -2.4900, 4.7461), (50, 2.5, 0, 50, 0, -2.5, 4.3065),
    (50, 2.5, 0, 73, 25, -18, 27.1492), (50, 2.5, 0, 56, -27, -3, 31.9030), (50, 2.5, 0, 50, 3.1736, 0.5854, 1.0000),
    (60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644),
    (22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373),
    (90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381),
    (2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082),
])  # fmt: skip
PLAIN = np.array([[0.65, 0.20, 0.1142], [0.25, 0.85, -0.10], [0.02, -0.15, 0.9549]])
MATRIX = PLAIN * [1.6, 1.0, 1.4]
CENTRES, CORNERS = true_place().centres, true_place().corners
READINGS = REFERENCE @ np.linalg.inv(MATRIX).T


def test_ciede2000_on_the_published_pairs() -> None:
    difference = delta_e_2000(SHARMA[:, :3], SHARMA[:, 3:6])
    np.testing.assert_allclose(difference, SHARMA[:, 6], atol=5.1e-5)
    np.testing.assert_allclose(delta_e_2000(SHARMA[:, 3:6], SHARMA[:, :3]), difference, atol=1e-9)


def test_lab_and_back_and_its_slope() -> None:
    colours = np.random.default_rng(0).uniform(0.001, 1, (50, 3))
    np.testing.assert_allclose(lab_to_xyz(xyz_to_lab(colours)), colours, rtol=1e-12)
    np.testing.assert_allclose(xyz_to_lab(D50), [100, 0, 0], atol=1e-12)
    step = 1e-7 * np.array([0.0, 1.0, 0.0])
    slope = (xyz_to_lab(colours + step) - xyz_to_lab(colours - step)) / 2e-7
    np.testing.assert_allclose(slope, lab_slopes(colours)[:, :, 1], rtol=1e-4)


def test_the_true_matrix_comes_back_and_white_stays_white() -> None:
    fit = fit_colour(READINGS * 0.3, REFERENCE, CENTRES)
    np.testing.assert_allclose(fit.matrix @ fit.neutral, D50, rtol=1e-12)
    assert fit.neutral.max() == 1.0
    white = np.linalg.solve(MATRIX, D50)
    # The greys of the chart are nearly grey.
    np.testing.assert_allclose(fit.neutral, white / white.max(), rtol=0.02)
    assert fit.difference.mean() < 0.5
    assert fit.left_out.mean() < 0.7
    assert fit.unevenness < 1.02


@pytest.mark.parametrize("channels", [3, 4])
def test_uneven_light_does_not_tint_the_matrix_of_any_channels(channels: int) -> None:
    mixture = np.vstack([np.eye(3), [0.2, 0.5, 0.3]])[:channels]
    light = np.exp(0.35 * (CENTRES[:, 0] / 6) - 0.5 * (CENTRES[:, 1] / 4) ** 2)
    fit = fit_colour(READINGS @ mixture.T * light[:, None], REFERENCE, CENTRES)
    assert fit.matrix.shape == (3, channels)
    np.testing.assert_allclose(fit.matrix @ fit.neutral, D50, rtol=1e-9)
    assert fit.difference.mean() < 0.8
    np.testing.assert_allclose(fit.light / light * light.mean(), 1, atol=0.06)
    assert fit.unevenness > UNEVEN


def test_a_grey_row_is_monotone_and_linear() -> None:
    greys = REFERENCE[18:, 1]
    assert grey_row_fault(0.3 * greys * 0.95 ** np.arange(6), greys) is None
    assert "darker" in str(grey_row_fault(greys[::-1], greys))
    assert "not linear" in str(grey_row_fault(greys ** (1 / 2.2), greys))


def off(place: ChartPlace, truth: ChartPlace) -> float:
    """Largest distance between patch centres, in patches."""
    difference = place.patch_corners(0.0)[:, 0] - truth.patch_corners(0.0)[:, 0]
    return float(np.hypot(*difference.T).max() / truth.pitch)


def wall() -> FloatArray:
    """Bricks of many colours, and white mortar."""
    bricks = 0.25 + 0.2 * np.random.default_rng(0).random((40, 30, 1)) * [1.0, 0.55, 0.4]
    wall = np.kron(bricks, np.ones((20, 40, 1))).astype(np.float32)[:600, :900]
    wall[::20], wall[1::20], wall[:, ::40], wall[:, 1::40] = 0.6, 0.6, 0.6, 0.6
    return wall


def test_the_chart_is_found_in_perspective_upside_down_and_in_front_of_bricks() -> None:
    """In uneven light, by the right one of its corners."""
    bricks, true = wall(), np.array(CORNERS)
    bricks[130 : 130 + HEIGHT, 220 : 220 + WIDTH] = chart().rgb
    for scene, corners, period in (
        *((chart().rgb, true, period) for period in (4, 6, 8)),
        (chart().rgb[::-1, ::-1], (WIDTH, HEIGHT) - true, 6),
        (bricks, np.add(true, (220, 130)), 6),
    ):
        found = find_chart(frame(scene, period), REFERENCE)
        assert off(found, ChartPlace(as_rows(corners))) < 0.1, (corners, period)


@pytest.mark.parametrize("name", ["chart/g2_full.crw", "raw/outdoor2.dng", "raw/outdoor4.dng"])
def test_the_charts_of_photographs_are_found(name: str) -> None:
    taken = shot_of(name, 4)
    place = find_chart(taken, REFERENCE)
    levels = patch_samples(taken, place.measured()).mean[:, :-1]
    assert fit_colour(levels, REFERENCE, place.centres).difference.mean() < 5


def far() -> Mosaic:
    """The chart at a quarter of its size, by a camera with large blocks."""
    scene = np.full((300, 400, 3), 0.35)
    centres = chart().rgb.reshape(HEIGHT // 4, 4, WIDTH // 4, 4, 3)
    scene[100:200, 120:270] = centres.mean(axis=(1, 3))
    return frame(scene, 8)


Look = Callable[[], object]


def at(corners: Matrix, scene: FloatArray) -> object:
    return chart_at(frame(scene), corners, REFERENCE)


FAR_CORNERS = as_rows(np.array(CORNERS) / 4 + (120, 100))
NONE, SMALL = "no ColorChecker was found whole", f"too small.*period 8 needs {least_pitch(8)}"


@pytest.mark.parametrize(
    ("look", "words"),
    [
        (lambda: find_chart(frame(wall()), REFERENCE), NONE),
        (lambda: find_chart(frame(chart().rgb[:, ::-1]), REFERENCE), NONE),
        (lambda: find_chart(frame(chart().rgb[:, :470]), REFERENCE), NONE),
        (lambda: find_chart(shot_of("chart/g2_cut_off.crw", 4), REFERENCE), NONE),
        (lambda: find_chart(far(), REFERENCE), SMALL),
        (lambda: chart_at(far(), FAR_CORNERS, REFERENCE), SMALL),
        (lambda: at(as_rows(rectangle(5, 5, 300, 200)), chart().rgb), "there is no ColorChecker"),
        (lambda: at(as_rows(rectangle(50, 50, 700, 300)), chart().rgb), "outside the frame"),
        (lambda: at(CORNERS[::-1], chart().rgb), "clockwise"),
        (lambda: at(CORNERS, 0.8 * chart().rgb ** (1 / 2.2)), "not linear|colours are not"),
        (lambda: fit_colour(READINGS * [1, 1, 0], REFERENCE, CENTRES), "no light"),
    ],
)
def test_what_is_no_chart_is_refused_with_the_reason(look: Look, words: str) -> None:
    with pytest.raises(InputError, match=words):
        look()
