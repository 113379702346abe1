"""Smoothing and derivatives by sampled Gaussians, cut off at four standard deviations; pictures are
mirrored at the border.
"""

import math

import numpy as np

from panchroma.shared.arrays import DoubleArray


def gaussian(sigma: float) -> dict[int, float]:
    """Distance in pixels -> weight; the weights sum to one."""
    radius = int(4 * sigma + 0.5)
    values = {x: math.exp(-(x**2) / (2 * sigma**2)) for x in range(-radius, radius + 1)}
    total = sum(values.values())
    return {x: value / total for x, value in values.items()}


def _shifts(picture: DoubleArray, axis: int, radius: int) -> dict[int, DoubleArray]:
    """picture[n + x] for every x in -radius..radius."""
    padding = [(0, 0), (0, 0)]
    padding[axis] = (radius, radius)
    wide = np.pad(picture, padding, mode="reflect")
    size = picture.shape[axis]
    return {
        x: np.take(wide, range(radius + x, radius + x + size), axis=axis)
        for x in range(-radius, radius + 1)
    }


def smooth(picture: DoubleArray, sigma: float, axis: int) -> DoubleArray:
    """The picture convolved with a Gaussian along one axis."""
    kernel = gaussian(sigma)
    shifts = _shifts(picture, axis, max(kernel))
    return sum((weight * shifts[x] for x, weight in kernel.items()), np.zeros_like(picture))


def blur(picture: DoubleArray, sigma: float) -> DoubleArray:
    """The picture convolved with a Gaussian along both axes."""
    return smooth(smooth(picture, sigma, 0), sigma, 1)


def derivative(picture: DoubleArray, sigma: float, axis: int) -> DoubleArray:
    """G_hs * l of Eq. 13: the slope along `axis`, smoothed across it; exactly zero where the
    picture is constant.
    """
    across = smooth(picture, sigma, 1 - axis)
    kernel = gaussian(sigma)
    shifts = _shifts(across, axis, max(kernel))
    slopes = (
        x / sigma**2 * weight * (shifts[x] - shifts[-x]) for x, weight in kernel.items() if x > 0
    )
    return sum(slopes, np.zeros_like(picture))
