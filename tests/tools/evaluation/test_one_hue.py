"""Several hues where there is one are found; one that is off everywhere, edges and flat places are not."""

import numpy as np

from shared.arrays import FloatArray
from tools.evaluation.hue import uneven_hue


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
