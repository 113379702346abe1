"""Hues that are wrong, and colour that fades: what the eye sees, whatever light and exposure."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.shared.arrays import FloatArray
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from panchroma.shared.white_balance import shades_of_grey
from panchroma.tools.evaluation.hue import PLACES, colour_kept, wrong_hue
from panchroma.tools.io.colour import xyz_to_lab
from panchroma.tools.io.colour_difference import delta_e_2000

RNG = np.random.default_rng(3)


def scene() -> FloatArray:
    """Muted colours about a grey mean, float32 (70, 80, 3)."""
    return (0.3 + 0.1 * RNG.random((70, 80, 3))).astype(np.float32)


@pytest.mark.parametrize("exposure", [0.05, 1.0])
@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.4, 1.0, 0.6)])
def test_a_spot_of_another_colour_is_found_in_any_light(
    light: tuple[float, float, float], exposure: float
) -> None:
    truth = scene()
    spoiled = truth.copy()
    spoiled[10:20, 30:45] = (0.5, 0.2, 0.2)
    gain = np.array(light, np.float32) * np.float32(exposure)
    wrong = wrong_hue(spoiled * gain, truth * gain)
    assert wrong[10:20, 30:45].all()
    assert wrong.sum() == 150


def test_noise_that_nobody_sees_is_no_wrong_hue() -> None:
    truth, black = scene(), np.zeros((40, 40, 3), np.float32)
    assert not wrong_hue(truth, truth).any()
    assert not wrong_hue(black, black).any()
    noise = 0.002 * RNG.standard_normal(truth.shape).astype(np.float32)
    assert not wrong_hue(truth + noise, truth).any()


def test_it_is_ten_of_ciede2000_on_a_balanced_picture() -> None:
    """Written out for one picture: grey mean, 99 % of luminance below 0.9, clipped."""
    truth = scene() * np.array((0.5, 1.0, 0.7), np.float32)
    rendered = truth + RNG.normal(0, 0.03, truth.shape).astype(np.float32)
    to_xyz = np.array(SRGB_TO_XYZ)
    mean = truth.mean(axis=(0, 1), dtype=np.float64)
    balanced = [picture.astype(np.float64) / mean for picture in (rendered, truth)]
    white = np.quantile((balanced[1] @ to_xyz.T)[..., 1], 0.99) / 0.9
    first, second = (xyz_to_lab(np.clip(picture / white, 0, 1) @ to_xyz.T) for picture in balanced)
    difference = delta_e_2000(first, second)
    clear = abs(difference - 10) > 1e-3  # single precision
    assert (wrong_hue(rendered, truth) == (difference > 10))[clear].all()
    assert 0.05 < wrong_hue(rendered, truth).mean() < 0.95


def patches(light: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> FloatArray:
    """Coloured patches that grow brighter to the right, float32 (150, 300, 3)."""
    colours = gaussian_filter(RNG.random((150, 300, 3)), (10, 10, 0))
    colours = 1 + 3 * (colours - colours.mean(axis=(0, 1))) / colours.std()
    brighter = np.linspace(0.05, 0.5, 300)[:, None]
    return (brighter * np.clip(colours, 0.1, 8) / 4 * light).astype(np.float32)


def faded(truth: FloatArray, kept: FloatArray | float) -> FloatArray:
    """The scene with a part of its colour kept: balanced, mixed with its luminance, and back."""
    white = np.array(shades_of_grey(truth))
    balanced = truth / white
    grey = balanced.mean(axis=2, keepdims=True)
    return ((grey + kept * (balanced - grey)) * white).astype(np.float32)


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.5, 1.0, 0.6)])
def test_the_part_that_is_kept_in_every_bin(light: tuple[float, float, float]) -> None:
    truth = patches(light)
    kept, true = colour_kept(faded(truth, 0.7), truth)
    np.testing.assert_allclose(kept / true, 0.7, rtol=1e-4)


def test_it_shows_where_colour_fades() -> None:
    truth = patches()
    kept = np.where(np.arange(300) < 130, 0.5, 1.0)[:, None].astype(np.float32)
    kept, true = colour_kept(faded(truth, kept), truth)
    slopes = kept / true
    assert slopes[0] < 0.65
    assert slopes[-1] > 0.95
    assert len(slopes) == len(PLACES)


def test_noise_fades_nothing_and_grey_has_no_slope() -> None:
    truth = patches()
    kept, true = colour_kept(truth + RNG.normal(0, 0.03, truth.shape).astype(np.float32), truth)
    np.testing.assert_allclose(kept / true, 1, atol=0.03)
    assert not colour_kept(truth, np.repeat(truth[..., :1], 3, axis=2)).any()
