"""Drawn scenes, with what photographs show too rarely, and examples: repeatable, and aligned with
the truth.
"""

from collections.abc import Callable

import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.shared.arrays import FloatArray
from panchroma.tools.training.drawings import SIZE, drawing, page
from panchroma.tools.training.examples import DRAWN, PAGE, make_example

SMALL = "builtin:200x150"
PAPER = CfaPattern.bayer(6)


@pytest.mark.parametrize("source", [SMALL, DRAWN, PAGE])
def test_the_same_seed_gives_the_same_example(source: str) -> None:
    first, again, other = (make_example(source, PAPER, (0, seed)) for seed in (1, 1, 2))
    assert all(map(np.array_equal, first, again))
    assert not np.array_equal(first[0], other[0])


@pytest.mark.parametrize("period", [4, 5, 6, 8])
def test_picture_and_truth_show_the_same_place(period: int) -> None:
    picture, truth, error, variance = make_example(SMALL, CfaPattern.bayer(period), (0, period))
    rows, columns = error.shape[1:]
    assert picture.shape == truth.shape == (3, rows * period, columns * period)
    assert variance.shape == (1, rows, columns)
    picture, truth = picture.astype(np.float64), truth.astype(np.float64)
    here = float(np.square(picture - truth).mean())
    for shift in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        assert here < 0.5 * float(np.square(np.roll(picture, shift, (1, 2)) - truth).mean())


@pytest.mark.parametrize(("draw", "most"), [(drawing, 1.001), (page, 1.7)])
def test_drawings_are_light(draw: Callable[[np.random.Generator], FloatArray], most: float) -> None:
    for seed in range(12):
        light = draw(np.random.default_rng(seed))
        assert light.shape == (SIZE, SIZE, 3)
        assert light.dtype == np.float32
        assert 0 < light.min() <= light.max() <= most
