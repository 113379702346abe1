"""Comparison of arrays that names the place where they differ most."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def assert_close(actual: NDArray[Any], expected: NDArray[Any], within: float) -> None:
    """Fail unless the shapes are equal and no element differs by more than `within`. A NaN on
    either side fails.
    """
    if actual.shape != expected.shape:
        raise AssertionError(f"shape {actual.shape}, expected {expected.shape}")
    far = np.abs(actual.astype(np.float64) - expected.astype(np.float64))
    wrong = ~(far <= within)
    if wrong.any():
        furthest = int(np.argmax(np.where(np.isnan(far), np.inf, far)))
        place = tuple(int(i) for i in np.unravel_index(furthest, far.shape))
        raise AssertionError(
            f"{int(wrong.sum())} of {far.size} values are further than {within:g} away, "
            f"the furthest at {place}: {actual[place]!r}, expected {expected[place]!r} "
            f"({far[place]:.3g} away)"
        )
