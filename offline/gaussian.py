"""Sampled Gaussians, cut off at four standard deviations, and smoothing with them."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.arrays import BORDER, FloatArray

Planes = TypeVar("Planes", bound=NDArray[np.floating[Any]])

_TRUNCATE = 4  # standard deviations at which the Gaussian ends


def gaussian(sigma: float) -> FloatArray:
    """Taps of a Gaussian, which sum to one: float32, an odd number of them. sigma: > 0, standard deviation in samples."""
    radius = int(_TRUNCATE * sigma + 0.5)
    taps = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    normalised: FloatArray = (taps / taps.sum()).astype(np.float32)
    return normalised


def smoothed(planes: Planes, sigma: float) -> Planes:
    """`planes` (..., rows, columns) convolved with a Gaussian along rows and columns, mirrored at the border; same type.

    sigma: standard deviation in samples; 0 changes nothing.
    """
    if sigma == 0:
        return planes
    taps = gaussian(sigma)
    for _ in range(2):
        planes = np.swapaxes(planes, -1, -2)
        size = planes.shape[-1]
        wide = np.pad(planes, [(0, 0)] * (planes.ndim - 1) + [(len(taps) // 2,) * 2], mode=BORDER)
        planes = sum(tap * wide[..., start : start + size] for start, tap in enumerate(taps))
    return planes
