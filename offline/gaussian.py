"""Sampled Gaussians, cut off at four standard deviations, and smoothing with them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray

from .kernels.smoothing import smooth

TRUNCATE = 4
"""Standard deviations at which a Gaussian ends: what lies beyond is 6e-5 of it."""


def gaussian(sigma: float) -> FloatArray:
    """Taps of a Gaussian, which sum to one: float32, an odd number of them. sigma: > 0, standard deviation in samples."""
    radius = int(TRUNCATE * sigma + 0.5)
    taps = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    return (taps / taps.sum()).astype(np.float32)


def smoothed(planes: NDArray[Any], sigma: float) -> FloatArray:
    """`planes` (..., rows, columns) convolved with a Gaussian along rows and columns, mirrored at the border; float32.

    sigma: standard deviation in samples; 0 changes nothing.
    """
    return filtered(planes, gaussian(sigma)) if sigma else np.ascontiguousarray(planes, np.float32)


def filtered(planes: NDArray[Any], taps: FloatArray) -> FloatArray:
    """As `smoothed`, by the taps of another symmetric filter, an odd number."""
    source = np.ascontiguousarray(planes, np.float32)
    found, shape = np.empty_like(source), (-1, *source.shape[-2:])
    for plane, out in zip(source.reshape(shape), found.reshape(shape), strict=True):
        smooth(plane, taps, out)
    return found
