"""Drawn scenes, with what photographs show too rarely, and examples: repeatable, aligned with the
truth, and kept whole.
"""

from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.tools.training.drawings import SIZE, drawing
from panchroma.tools.training.examples import DRAWN, load_example, make_example, save_example

SMALL = "builtin:200x150"
PAPER = CfaPattern.bayer(6)


@pytest.mark.parametrize("source", [SMALL, DRAWN])
def test_the_same_seed_gives_the_same_example(source: str) -> None:
    first, again, other = (make_example(source, PAPER, (0, seed)) for seed in (1, 1, 2))
    assert all(np.array_equal(getattr(first, name), getattr(again, name)) for name in vars(first))
    assert not np.array_equal(first.picture, other.picture)


@pytest.mark.parametrize("period", [4, 5, 6, 8])
def test_picture_and_truth_show_the_same_place(period: int) -> None:
    example = make_example(SMALL, CfaPattern.bayer(period), (0, period))
    rows, columns = example.error.shape[1:]
    assert example.picture.shape == example.truth.shape == (3, rows * period, columns * period)
    assert example.variance.shape == (1, rows, columns)
    picture, truth = example.picture.astype(np.float64), example.truth.astype(np.float64)
    here = float(np.square(picture - truth).mean())
    for shift in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        assert here < 0.5 * float(np.square(np.roll(picture, shift, (1, 2)) - truth).mean())


def test_an_example_survives_the_disk(tmp_path: Path) -> None:
    example, path = make_example(SMALL, CfaPattern.bayer(4), (3,)), tmp_path / "0-00000.npz"
    save_example(example, path)
    again = vars(load_example(path))
    assert all(np.array_equal(array, again[name]) for name, array in vars(example).items())
    assert list(tmp_path.iterdir()) == [path]


def test_drawings_are_light() -> None:
    for seed in range(6):
        light = drawing(np.random.default_rng(seed))
        assert light.shape == (SIZE, SIZE, 3)
        assert light.dtype == np.float32
        assert 0 < light.min() <= light.max() <= 1.001
