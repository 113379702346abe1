"""Eqs. 15-16: non-local averaging of chromaticity, with weights from luminance."""

import numpy as np
from scipy.ndimage import gaussian_filter

from panchroma.shared.arrays import DoubleArray


def matches(
    luminance: DoubleArray, radius: int, h: float, std: float
) -> list[tuple[int, int, DoubleArray]]:
    """(down, right, weights) for each n' = n + (down, right) of the window: the weights of Eq. 16,
    (H, W), before normalisation.
    """
    height, width = luminance.shape
    reach = int(4 * std + 0.5)  # where the Gaussian ends
    # the patches around n and n' are patches of the mirrored picture
    wide = np.pad(luminance, radius + reach, mode="reflect")
    centre = wide[radius : wide.shape[0] - radius, radius : wide.shape[1] - radius]
    frame = slice(reach, reach + height), slice(reach, reach + width)
    found = []
    for down in range(-radius, radius + 1):
        for right in range(-radius, radius + 1):
            other = wide[radius + down :, radius + right :][: centre.shape[0], : centre.shape[1]]
            distance = gaussian_filter((other - centre) ** 2, std, mode="mirror")[frame]
            weight = np.exp(-distance / (2 * h**2)) * np.maximum(other[frame], 0.0)  # Eq. 16
            found.append((down, right, weight))
    return found


def refine(
    initial: DoubleArray,
    luminance: DoubleArray,
    period: int,
    *,
    h: float,
    blur_periods: float,
    repetitions: int,
) -> DoubleArray:
    """Chromaticity after all repetitions of Eq. 15, (H, W, C). blur_periods: standard deviation of
    G, periods.
    """
    height, width = luminance.shape
    radius = period // 2
    weights = matches(luminance, radius, h, period * blur_periods)
    total = np.sum([weight for _, _, weight in weights], axis=0)
    current = initial
    for _ in range(repetitions):
        wide = np.pad(current, ((radius, radius), (radius, radius), (0, 0)), mode="reflect")
        mixed = np.zeros_like(current)
        for down, right, weight in weights:
            other = wide[radius + down :, radius + right :][:height, :width]
            mixed += weight[..., None] * other
        mean = mixed / np.where(total > 0, total, 1.0)[..., None]  # Eq. 15
        current = np.where((total > 0)[..., None], mean, current)
    return current
