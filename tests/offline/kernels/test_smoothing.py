"""Smoothing of planes against a plain convolution."""

import numpy as np
import pytest
from scipy.ndimage import correlate1d

from panchroma.offline.numerics.gaussian import gaussian, smooth

FLOAT32 = 1e-6


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (130, 33), (70, 16)])
def test_equals_a_convolution(shape: tuple[int, int]) -> None:
    plane, taps = np.random.default_rng(0).random(shape, dtype=np.float32), gaussian(1.5)
    found = np.empty(shape, np.float32)
    smooth(plane, taps, found)
    expected = correlate1d(
        correlate1d(plane.astype(np.float64), taps, 0, mode="mirror"), taps, 1, mode="mirror"
    )
    assert np.abs(found - expected).max() < FLOAT32
