"""Drawn scenes: in range, and with what photographs show too rarely."""

import numpy as np

from tools.training.drawings import SIZE, colour, drawing


def test_drawings_are_light() -> None:
    for seed in range(6):
        found = drawing(np.random.default_rng(seed))
        assert found.shape == (SIZE, SIZE, 3)
        assert found.dtype == np.float32
        assert 0 < found.min() <= found.max() <= 1.001


def test_colours_are_grey_saturated_or_between() -> None:
    random = np.random.default_rng(0)
    found = np.array([colour(random) for _ in range(600)])
    saturation = 1 - found.min(axis=1) / found.max(axis=1)
    assert 0.2 < (saturation == 0).mean() < 0.45
    assert (saturation > 0.8).mean() > 0.2
    assert (found > 0).all()
