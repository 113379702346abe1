"""Comparison of arrays that have to be of one shape."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def assert_close(actual: NDArray[Any], expected: NDArray[Any], within: float) -> None:
    """Fail unless the shapes are equal and no element differs by more than `within`. A NaN on
    either side fails.
    """
    assert actual.shape == expected.shape
    one, other = (array.astype(np.float64) for array in (actual, expected))
    np.testing.assert_allclose(one, other, rtol=0, atol=within, equal_nan=False)
