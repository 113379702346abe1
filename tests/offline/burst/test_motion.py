"""Where a motion puts points, and back."""

import numpy as np
import pytest

from panchroma.offline.burst import Motion, in_frame, in_reference
from panchroma.offline.burst.motion import displaced
from panchroma.shared.arrays import DoubleArray
from panchroma.shared.errors import InputError
from tests.offline.burst.scenes import pixels
from tests.reference.compare import assert_close

SHAPE = (41, 60)
PIXELS = pixels(SHAPE)
EXACT = 2e-5  # pixels: rounding of places in a frame of this size to float32
LOCAL = np.random.default_rng(0).uniform(-0.4, 0.4, (4, 5, 2)).astype(np.float32)
TURNED = Motion((1.5, 0.25), -0.01, LOCAL)


def parabola(y: DoubleArray, x: DoubleArray) -> DoubleArray:
    return 1 + y / 30 + (x / 40) ** 2 - y * x / 3000


def test_a_positive_angle_turns_what_is_below_the_centre_to_the_right() -> None:
    # the centre: (20, 30)
    place = in_frame(Motion(angle=np.pi / 2), 30, 30, (41, 61))
    np.testing.assert_allclose(place, (20, 40), atol=EXACT)


def test_local_shifts_are_bilinear_between_nodes_and_end_on_the_outermost_pixels() -> None:
    local = np.zeros((2, 3, 2), np.float32)
    local[0, 0], local[1, 2] = (1, 2), (4, 0)
    y, x = np.indices((11, 21))
    first, last = (1 - y / 10) * np.maximum(1 - x / 10, 0), y / 10 * np.maximum(x / 10 - 1, 0)
    down, across = in_frame(Motion(local=local), y, x, (11, 21))
    np.testing.assert_allclose(down - y, first + 4 * last, atol=EXACT)
    np.testing.assert_allclose(across - x, 2 * first, atol=EXACT)
    outside = in_frame(Motion(local=local), -5, -7, (11, 21))
    np.testing.assert_allclose(outside, (-4, -5), atol=EXACT)


@pytest.mark.parametrize("motion", [Motion((2.3, -7.1)), Motion((-0.4, 1.2), 0.03), TURNED])
def test_one_place_is_the_inverse_of_the_other(motion: Motion) -> None:
    down, across = in_frame(motion, *PIXELS, SHAPE)
    assert_close(in_reference(motion, down, across, SHAPE), np.array(PIXELS), EXACT)


def test_a_frame_of_larger_pixels_moves_by_fewer() -> None:
    half = Motion((0.75, 0.125), -0.01, LOCAL * np.float32(0.5))
    places = in_frame(half, *PIXELS, SHAPE)
    assert np.array_equal(in_frame(TURNED.times(0.5), *PIXELS, SHAPE), places)


@pytest.mark.parametrize("motion", [Motion((2.3, -7.1)), TURNED])
def test_a_plane_is_displaced_by_cubic_interpolation(motion: Motion) -> None:
    """Which keeps parabolas, away from the outermost pixels."""
    plane = parabola(*PIXELS).astype(np.float32)
    result, (down, across) = displaced(plane, motion), in_frame(motion, *PIXELS, SHAPE)
    inside = (down >= -0.5) & (down < SHAPE[0] - 0.5) & (across >= -0.5) & (across < SHAPE[1] - 0.5)
    assert np.array_equal(np.isfinite(result), inside)
    deep = (down > 1) & (down < SHAPE[0] - 2) & (across > 1) & (across < SHAPE[1] - 2)
    assert_close(result[deep], parabola(down, across)[deep], 1e-4)


def test_a_motion_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="expected finite numbers"):
        Motion((np.nan, 0))
    with pytest.raises(InputError, match=r"local shifts \(1, 4, 2\): expected"):
        Motion(local=np.zeros((1, 4, 2), np.float32))
