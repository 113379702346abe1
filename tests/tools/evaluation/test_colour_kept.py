"""Colour that fades is found, where it fades, in any light; noise is not taken for it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from shared.arrays import FloatArray
from shared.white_balance import shades_of_grey
from tools.evaluation.hue import PLACES, colour_kept

RNG = np.random.default_rng(5)


def scene(light: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> FloatArray:
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
    truth = scene(light)
    seen, true = colour_kept(faded(truth, 0.7), truth)
    np.testing.assert_allclose(seen / true, 0.7, rtol=1e-4)


def test_it_shows_where_colour_fades() -> None:
    truth = scene()
    kept = np.where(np.arange(300) < 130, 0.5, 1.0)[:, None].astype(np.float32)
    seen, true = colour_kept(faded(truth, kept), truth)
    slopes = seen / true
    assert slopes[0] < 0.65
    assert slopes[-1] > 0.95
    assert len(slopes) == len(PLACES)


def test_noise_fades_nothing_and_grey_has_no_slope() -> None:
    truth = scene()
    seen, true = colour_kept(truth + RNG.normal(0, 0.03, truth.shape).astype(np.float32), truth)
    np.testing.assert_allclose(seen / true, 1, atol=0.03)
    grey = np.repeat(truth[..., :1], 3, axis=2)
    assert not colour_kept(truth, grey).any()
