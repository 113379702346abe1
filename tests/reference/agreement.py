"""How far two planes differ in units of what is tolerated, in float64, one formula after the other."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import correlate1d

from offline.burst import agreement as settings
from shared.arrays import DoubleArray

Noise = tuple[float, float]
"""Shot, and squared read noise."""


def means(weight: DoubleArray, sigma: float, planes: Sequence[DoubleArray]) -> list[DoubleArray]:
    """Weighted means around each pixel."""
    reach = int(4 * sigma + 0.5)
    taps = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2 * sigma**2))
    taps /= taps.sum()

    def smooth(plane: DoubleArray) -> DoubleArray:
        smoothed: DoubleArray = correlate1d(correlate1d(plane, taps, 0, mode="mirror"), taps, 1, mode="mirror")
        return smoothed

    return [smooth(weight * plane) / smooth(weight) for plane in planes]


def kept(sigma: float) -> float:
    """The share of the variance of noise that such a mean keeps."""
    reach = int(4 * sigma + 0.5)
    taps = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2 * sigma**2))
    return float(1.2 * (np.square(taps).sum() / taps.sum() ** 2) ** 2)


def compared(reference: DoubleArray, frame: DoubleArray, weight: DoubleArray, noise: tuple[Noise, Noise]) -> DoubleArray:
    """The squared difference in units of what is tolerated, (H, W)."""
    own, other = (shot * np.maximum(plane, 0) + read for plane, (shot, read) in zip((reference, frame), noise, strict=True))
    apart, both = frame - reference, own + other
    planes = reference, frame, reference**2, frame**2, apart, apart**2
    light, shown, power, power_shown, mean, rest = means(weight, settings._NEAR, planes)
    contrast = np.minimum(power - light**2 - own, power_shown - shown**2 - other).clip(0)
    even, deviations = (settings._LIGHT * light) ** 2, settings._DEVIATIONS
    tolerated, near = settings._MEAN**2 * contrast + even, kept(settings._NEAR)
    of_mean = mean**2 / (tolerated + deviations**2 * near * both + 1e-12)
    rest = np.maximum(rest - both * (1 + deviations * (2 * near) ** 0.5), 0)
    of_texture = rest / (settings._TEXTURE**2 * contrast + 4 * even + 0.3 * both + 1e-12)
    cap = settings._CAP * np.sqrt(both + tolerated)
    mean, contrast = means(weight, settings._WIDE, (np.clip(apart, -cap, cap), contrast))
    spread = deviations**2 * kept(settings._WIDE) * both
    of_neighbourhood = mean**2 / (settings._FAR**2 * contrast + even + spread + 1e-12)
    down, across = (np.asarray(slope, np.float64) for slope in np.gradient((reference + frame) / 2))
    gradients = [down**2, down * across, across**2, down * apart, across * apart]
    dd, da, aa, d, a = means(weight, settings._MOVED, gradients)
    least = both / 4 + (0.003 * light) ** 2 + 1e-12
    dd, aa = (np.maximum(each - both / 4, 0) + least for each in (dd, aa))
    explained = (aa * d**2 - 2 * da * d * a + dd * a**2) / np.maximum(dd * aa - da**2, 1e-3 * dd * aa)
    spread = deviations**2 * kept(settings._MOVED) * both
    of_shift = explained / (settings._SHIFT**2 * (dd + aa) + even + spread + 1e-12)
    found: DoubleArray = np.max([of_mean, of_texture, of_neighbourhood, of_shift], axis=0)
    return found
