"""Hues that are wrong or several where there is one, and colour that fades: what the eye sees, whatever light and exposure."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from shared.arrays import FloatArray
from shared.colorimetry import SRGB_TO_XYZ
from shared.white_balance import shades_of_grey
from tools.evaluation.hue import PLACES, colour_kept, uneven_hue, wrong_hue
from tools.io.colour import xyz_to_lab
from tools.io.colour_difference import delta_e_2000

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


def words() -> FloatArray:
    """Blue strokes of four pixels on white, float32 (90, 120, 3)."""
    light = np.full((90, 120, 3), 0.8, np.float32)
    for left in range(6, 116, 12):
        light[10:80, left : left + 4] = 0.05, 0.1, 0.4
    return light


def test_the_truth_is_even_and_so_is_one_hue_that_is_off_everywhere() -> None:
    truth = words()
    assert not uneven_hue(truth, truth).any()
    greyer = np.where(truth < 0.5, 0.5 * truth + 0.5 * truth.mean(axis=2, keepdims=True), truth).astype(np.float32)
    assert not uneven_hue(greyer, truth)[12:78].any()


def test_letters_of_other_hues_in_one_word_are_found_where_they_are() -> None:
    truth = words()
    shown = truth.copy()
    shown[40:52, 54:58] = 0.05, 0.3, 0.15  # part of one stroke is teal
    found = uneven_hue(shown, truth)
    assert found[42:50, 54:58].mean() > 0.5
    assert not found[:, :40].any()
    assert not found[:, 72:].any()


def test_black_print_with_colours_is_its_simplest_case() -> None:
    truth = np.where(words() < 0.5, 0.06, 0.8).astype(np.float32)
    shown = truth.copy()
    random = np.random.default_rng(0)
    shown[truth[..., 0] < 0.5] += random.uniform(0, 0.2, (int((truth[..., 0] < 0.5).sum()), 3)).astype(np.float32)
    assert uneven_hue(shown, truth)[truth[..., 0] < 0.5].mean() > 0.3
    assert not uneven_hue(truth, truth).any()


def patches(light: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> FloatArray:
    """Coloured patches that grow brighter to the right, float32 (150, 300, 3)."""
    colours = gaussian_filter(RNG.random((150, 300, 3)), (10, 10, 0))
    colours = 1 + 3 * (colours - colours.mean(axis=(0, 1))) / colours.std()
    return (np.linspace(0.05, 0.5, 300)[:, None] * np.clip(colours, 0.1, 8) / 4 * light).astype(np.float32)


def faded(truth: FloatArray, kept: FloatArray | float) -> FloatArray:
    """The scene with a part of its colour kept: balanced, mixed with its luminance, and back."""
    white = np.array(shades_of_grey(truth))
    balanced = truth / white
    grey = balanced.mean(axis=2, keepdims=True)
    return ((grey + kept * (balanced - grey)) * white).astype(np.float32)


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.5, 1.0, 0.6)])
def test_the_part_that_is_kept_in_every_bin(light: tuple[float, float, float]) -> None:
    truth = patches(light)
    seen, true = colour_kept(faded(truth, 0.7), truth)
    np.testing.assert_allclose(seen / true, 0.7, rtol=1e-4)


def test_it_shows_where_colour_fades() -> None:
    truth = patches()
    kept = np.where(np.arange(300) < 130, 0.5, 1.0)[:, None].astype(np.float32)
    seen, true = colour_kept(faded(truth, kept), truth)
    slopes = seen / true
    assert slopes[0] < 0.65
    assert slopes[-1] > 0.95
    assert len(slopes) == len(PLACES)


def test_noise_fades_nothing_and_grey_has_no_slope() -> None:
    truth = patches()
    seen, true = colour_kept(truth + RNG.normal(0, 0.03, truth.shape).astype(np.float32), truth)
    np.testing.assert_allclose(seen / true, 1, atol=0.03)
    grey = np.repeat(truth[..., :1], 3, axis=2)
    assert not colour_kept(truth, grey).any()
