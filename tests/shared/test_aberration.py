"""Lateral chromatic aberration as a value, in calibrations and files, and in what a sensor sees."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from shared import Aberration, CfaPattern, SensorCalibration
from shared.errors import InputError
from shared.sensor import sample

SHAPE = (61, 90)
LENS = Aberration([(0.02, 0.01), (0, 0), (-0.01, -0.02)], SHAPE, 35)  # type: ignore[arg-type]
PATTERN = CfaPattern.bayer(6, origin=(4, 1))
BARE = SensorCalibration.of_bits(16, gamma=(0.9, 1.1, 0.8))
CALIBRATION = replace(BARE, aberration=LENS)


def scene() -> Any:
    return np.random.default_rng(1).uniform(0.1, 1, (*SHAPE, 3)).astype(np.float32)


def test_channels_are_displaced_by_cubic_splines() -> None:
    rgb, (y, x) = scene(), np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    y0, x0 = (SHAPE[0] - 1) / 2, (SHAPE[1] - 1) / 2
    square = ((y - y0) ** 2 + (x - x0) ** 2) / (y0**2 + x0**2)
    seen = LENS.displaced(rgb)
    for channel, (a, b) in enumerate(LENS.radial):
        size = 1 + a + b * square
        places = y0 + (y - y0) * size, x0 + (x - x0) * size
        expected = map_coordinates(rgb[..., channel].astype(float), places, order=3, mode="mirror")
        np.testing.assert_allclose(seen[..., channel], expected, atol=2e-6)
    assert np.array_equal(seen[..., 1], rgb[..., 1])


def test_displacements_are_told_in_pixels() -> None:
    half = np.hypot(60, 89) / 2
    assert LENS.corner(SHAPE) == pytest.approx((0.03 * half, 0, -0.03 * half))
    assert LENS.reach(SHAPE) == pytest.approx(0.03 * half)
    turning = Aberration([(0, 0), (0.04, -0.04), (0, 0)], SHAPE)  # type: ignore[arg-type]
    assert turning.corner(SHAPE) == (0, 0, 0)
    assert turning.reach(SHAPE) == pytest.approx(0.04 * half * 2 / 3 / 3**0.5, rel=1e-3)


def test_the_sensor_sees_what_the_lens_makes_of_a_scene() -> None:
    assert np.array_equal(sample(scene(), PATTERN, CALIBRATION), sample(LENS.displaced(scene()), PATTERN, BARE))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"radial": [(0.1, 0), (0, 0), (0, 0)]}, "holds a figure that is not -0.05 to 0.05"),
        ({"radial": [(float("nan"), 0), (0, 0), (0, 0)]}, "holds a figure"),
        ({"radial": [(0.01, 0), (0.01, 0), (0.01, 0)]}, "one channel with"),
        ({"radial": [0.01, 0, 0]}, "radial is 0.01, expected a list of numbers"),
        ({"radial": [("0.01", 0), (0, 0), (0, 0)]}, r"radial is \('0.01', 0\), expected a list of numbers"),
    ],
)
def test_what_is_none_is_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Aberration(**{"radial": LENS.radial, "size": SHAPE, **changed})


def test_other_channels_are_refused_and_another_focal_length_is_told() -> None:
    with pytest.raises(InputError, match=r"aberration has 2 channels, expected 3 \(RGB\)"):
        SensorCalibration(aberration=Aberration([(0, 0), (0, 0)], SHAPE))  # type: ignore[arg-type]
    assert LENS.zoomed(50) == "taken at 50 mm, but its chromatic aberration was measured at 35 mm: fringes may remain, or be made"
    assert LENS.zoomed(35.5) == LENS.zoomed(None) == ""
