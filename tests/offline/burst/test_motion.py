"""Where a motion puts pixels, and back."""

import numpy as np
import pytest

from offline.burst import Motion
from shared.errors import InputError

SHAPE = (41, 60)
EXACT = 2e-5  # pixels: rounding of places in a frame of this size to float32
LOCAL = np.random.default_rng(0).uniform(-0.4, 0.4, (4, 5, 2)).astype(np.float32)


def test_a_shift_moves_all_pixels_alike() -> None:
    down, across = Motion((2.0, -3.5)).places(slice(5, 9), SHAPE)
    assert down.tolist() == [[row + 2.0] * 60 for row in range(5, 9)]
    assert across.tolist() == [[column - 3.5 for column in range(60)]] * 4


def test_a_positive_angle_turns_what_is_below_the_centre_to_the_right() -> None:
    down, across = Motion(angle=np.pi / 2).places(slice(30, 31), (41, 61))
    np.testing.assert_allclose((down[0, 30], across[0, 30]), (20, 40), atol=EXACT)  # the centre is (20, 30)


def test_local_shifts_are_bilinear_between_nodes_and_end_on_the_outermost_pixels() -> None:
    local = np.zeros((2, 3, 2), np.float32)
    local[0, 0], local[1, 2] = (1, 2), (4, 0)
    down, across = Motion(local=local).places(slice(None), (11, 21))
    y, x = np.indices((11, 21))
    np.testing.assert_allclose(
        down - y, (1 - y / 10) * np.maximum(1 - x / 10, 0) + 4 * y / 10 * np.maximum(x / 10 - 1, 0), atol=EXACT
    )
    np.testing.assert_allclose(across - x, 2 * (1 - y / 10) * np.maximum(1 - x / 10, 0), atol=EXACT)


@pytest.mark.parametrize("motion", [Motion((2.3, -7.1)), Motion((-0.4, 1.2), 0.03), Motion((1.5, 0.25), -0.01, LOCAL)])
def test_back_is_the_way_back(motion: Motion) -> None:
    places = motion.places(slice(None), SHAPE)
    for found, true in zip(motion.back(*places, SHAPE), np.indices(SHAPE), strict=True):
        np.testing.assert_allclose(found, true, atol=EXACT)


def test_a_frame_of_larger_pixels_moves_by_fewer() -> None:
    motion, half = Motion((1.5, 0.25), -0.01, LOCAL), Motion((0.75, 0.125), -0.01, LOCAL * np.float32(0.5))
    for found, expected in zip(motion.times(0.5).places(slice(None), SHAPE), half.places(slice(None), SHAPE), strict=True):
        assert np.array_equal(found, expected)
    assert Motion().none
    assert not any(each.none for each in (motion, Motion((0.0, 1.0)), Motion(angle=0.1), Motion(local=LOCAL)))


def test_rows_are_parts_of_the_whole() -> None:
    motion = Motion((1.5, 0.25), -0.01, LOCAL)
    whole = motion.places(slice(None), SHAPE)
    part = motion.places(slice(7, 20), SHAPE)
    assert all(np.array_equal(each[7:20], rows) for each, rows in zip(whole, part, strict=True))


def test_a_motion_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="expected finite numbers"):
        Motion((np.nan, 0))
    with pytest.raises(InputError, match=r"local shifts of shape \(1, 4, 2\), expected"):
        Motion(local=np.zeros((1, 4, 2), np.float32))
