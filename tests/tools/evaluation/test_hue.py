"""Wrong hues: what the eye sees, whatever the light and the exposure."""

import numpy as np
import pytest

from shared.arrays import FloatArray
from shared.colorimetry import SRGB_TO_XYZ, xyz_to_lab
from shared.colour_difference import delta_e_2000
from tools.evaluation.hue import wrong_hue

RNG = np.random.default_rng(3)


def scene() -> FloatArray:
    """Muted colours about a grey mean, float32 (70, 80, 3)."""
    return (0.3 + 0.1 * RNG.random((70, 80, 3))).astype(np.float32)


@pytest.mark.parametrize("exposure", [0.05, 1.0])
@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.4, 1.0, 0.6)])
def test_a_spot_of_another_colour_is_found_in_any_light(light: tuple[float, float, float], exposure: float) -> None:
    truth = scene()
    spoiled = truth.copy()
    spoiled[10:20, 30:45] = (0.5, 0.2, 0.2)
    seen = np.array(light, np.float32) * np.float32(exposure)
    found = wrong_hue(spoiled * seen, truth * seen)
    assert found[10:20, 30:45].all()
    assert found.sum() == 150


def test_noise_that_nobody_sees_is_no_wrong_hue() -> None:
    truth = scene()
    assert not wrong_hue(truth, truth).any()
    assert not wrong_hue(truth + 0.002 * RNG.standard_normal(truth.shape).astype(np.float32), truth).any()


def test_it_is_ten_of_ciede2000_on_a_balanced_picture() -> None:
    """Written out for one picture: grey mean, 99 % of luminance below 0.9, clipped."""
    truth = scene() * np.array((0.5, 1.0, 0.7), np.float32)
    rendered = truth + RNG.normal(0, 0.03, truth.shape).astype(np.float32)
    to_xyz = np.array(SRGB_TO_XYZ)
    balanced = [picture.astype(np.float64) / truth.mean(axis=(0, 1), dtype=np.float64) for picture in (rendered, truth)]
    white = np.quantile((balanced[1] @ to_xyz.T)[..., 1], 0.99) / 0.9
    first, second = (xyz_to_lab(np.clip(picture / white, 0, 1) @ to_xyz.T) for picture in balanced)
    difference = delta_e_2000(first, second)
    clear = abs(difference - 10) > 1e-3  # single precision
    assert (wrong_hue(rendered, truth) == (difference > 10))[clear].all()
    assert 0.05 < wrong_hue(rendered, truth).mean() < 0.95


def test_a_black_picture_is_compared_too() -> None:
    assert not wrong_hue(np.zeros((40, 40, 3), np.float32), np.zeros((40, 40, 3), np.float32)).any()
