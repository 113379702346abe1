from contextlib import suppress

import numpy as np
import pytest

from shared import CfaPattern, Mosaic
from shared.colorimetry import as_rows
from shared.errors import InputError
from tests.tools.calibration.known_camera import BLIND, HEIGHT, WIDTH, chart, frame, true_place
from tools.calibration.chart.find import chart_at, find_chart
from tools.calibration.chart.lattice import lattice_corners
from tools.calibration.chart.picture import linear_picture
from tools.calibration.chart.place import ChartPlace, least_pitch
from tools.commands.calibrate import color_checker_xyz

REFERENCE = color_checker_xyz()


def off(place: ChartPlace, truth: ChartPlace) -> float:
    """Largest distance between patch centres, in patches."""
    centres = [each.patch_corners(0.0)[:, 0] for each in (place, truth)]
    return float(np.hypot(*(centres[0] - centres[1]).T).max() / truth.pitch)


@pytest.mark.parametrize("period", [4, 6, 8])
def test_the_chart_is_found_in_perspective_and_uneven_light(period: int) -> None:
    found = find_chart(frame(chart().rgb, period), REFERENCE)
    assert off(found.place, true_place()) < 0.08
    assert found.difference < 2


def test_upside_down_it_is_named_the_right_way_round() -> None:
    found = find_chart(frame(chart().rgb[::-1, ::-1]), REFERENCE)
    assert found.place.corners[0][0] > WIDTH / 2
    assert found.place.corners[0][1] > HEIGHT / 2


def test_lattices_find_it_without_the_detector() -> None:
    places = []
    for corners in lattice_corners(linear_picture(frame(chart().rgb)), 500):
        with suppress(InputError):  # where perspective is extrapolated, a window may turn inside out
            places += [ChartPlace(as_rows(turned)) for turned in (corners, np.roll(corners, 2, axis=0))]
    assert min(off(place, true_place()) for place in places) < 0.1


def test_in_front_of_a_brick_wall() -> None:
    rng = np.random.default_rng(0)
    bricks = 0.25 + 0.2 * rng.random((40, 30, 1)) * [1.0, 0.55, 0.4]
    wall = np.kron(bricks, np.ones((20, 40, 1))).astype(np.float32)[:600, :900]
    wall[::20], wall[1::20], wall[:, ::40], wall[:, 1::40] = 0.6, 0.6, 0.6, 0.6
    top, left = 130, 220
    wall[top : top + HEIGHT, left : left + WIDTH] = chart().rgb
    truth = ChartPlace(tuple((x + left, y + top) for x, y in true_place().corners))
    assert off(find_chart(frame(wall), REFERENCE).place, truth) < 0.1
    with pytest.raises(InputError, match="no ColorChecker was found"):
        find_chart(frame(wall[:100, :240]), REFERENCE)


def test_a_chart_that_is_cut_off_is_refused() -> None:
    with pytest.raises(InputError, match="no ColorChecker was found whole inside the frame"):
        find_chart(frame(chart().rgb[:, :470]), REFERENCE)


def test_a_chart_too_small_for_the_period_is_refused_with_the_size_it_needs() -> None:
    small = chart().rgb.reshape(HEIGHT // 4, 4, WIDTH // 4, 4, 3).mean(axis=(1, 3))
    wide = np.full((300, 400, 3), 0.35)
    wide[100:200, 120:270] = small
    place = ChartPlace(tuple((x / 4 + 120, y / 4 + 100) for x, y in true_place().corners))
    with pytest.raises(InputError, match=f"too small.*period 8 needs {least_pitch(8)}"):
        chart_at(frame(wide, 8), place.corners, REFERENCE)
    with pytest.raises(InputError, match=f"too small.*period 8 needs {least_pitch(8)}"):
        find_chart(frame(wide, 8), REFERENCE)


def test_corners_by_hand_pass_the_same_tests() -> None:
    shot = frame(chart().rgb)
    assert chart_at(shot, true_place().corners, REFERENCE).difference < 2
    refused: dict[str, tuple[tuple[float, ...], ...]] = {
        "there is no ColorChecker": ((5.0, 5.0), (300.0, 5.0), (300.0, 200.0), (5.0, 200.0)),
        "outside the frame": ((50.0, 50.0), (700.0, 50.0), (700.0, 300.0), (50.0, 300.0)),
        "clockwise": tuple(reversed(true_place().corners)),
    }
    for words, corners in refused.items():
        with pytest.raises(InputError, match=words):
            chart_at(shot, corners, REFERENCE)


def test_a_tone_curve_is_refused() -> None:
    curved = Mosaic(frame(0.8 * chart().rgb ** (1 / 2.2)).codes, CfaPattern.bayer(6), BLIND)
    with pytest.raises(InputError, match=r"not linear|colours are not"):
        chart_at(curved, true_place().corners, REFERENCE)
