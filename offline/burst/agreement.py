"""How far a frame agrees with the reference at each pixel, beyond noise: 0 where something moved, was hidden or changed.

They are compared where both measure luminance. The light has detail finer than a pixel, which each frame samples at other places
(aliasing), so edges and texture differ even where nothing has changed: differences are tolerated in proportion to the contrast of
both. Four signs show a change: another mean; differences as large as the texture; many small differences of one sign over a wide
neighbourhood (a pale thing in noise); and differences that a shift explains (a branch that sways by a part of a pixel).
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import minimum_filter

from shared.arrays import ByteArray, FloatArray

from ..gaussian import gaussian, smoothed
from .frames import CLIPPED, DEVIATIONS, NEIGHBOURHOOD, TINY, View

# Chosen; half and twice of each change drawn scenes, with noise, parallax or a moving thing, by 0.02 dB at most, or as said, and
# photographs (constants benchmark) by 0.05. What each finds: tests/offline/burst/test_agreement.py.
_SHIFTED, _WIDE = 2.0, 5.0  # pixels: standard deviations of larger neighbourhoods (photographs: 0.1, 0.0 dB)
_MEAN, _TEXTURE, _FAR = 0.3, 0.6, 0.1  # difference that is tolerated, a share of the contrast (photographs: 0.0, 0.3, 0.0 dB)
_LIGHT = 0.01  # of the light: what a changed exposure or a cloud may do
_SHIFT = 0.2  # pixels: what motion may be wrong by (parallax: 0.2 dB)
_POWER = 0.3  # of the variance of noise: how much the power of differences may vary
_GAPS = 1.2  # by which pixels that do not measure luminance raise the noise of a mean
_LOW, _HIGH = 0.3, 0.8  # raw agreement that counts as none, and as all: half-true ghosts of many frames would add up (0.2, 1.5 dB)
_FRINGE = 3  # pixels: size of the neighbourhood that has to agree as a whole
_BRIGHT = 0.92  # of the limit: light that counts less (bracket: 0.3 dB if none does)
_STRIP = 256  # rows that are compared at a time
_HALO = sum(len(gaussian(sigma)) // 2 for sigma in (NEIGHBOURHOOD, _WIDE)) + _FRINGE // 2  # rows around them that they depend on


def agreement(reference: View, frame: View, measured: FloatArray) -> ByteArray:
    """How far a frame agrees with the reference at each pixel, 0 to 255, uint8 (H, W).

    frame: as the reference would see it, in units of the reference; NaN where it sees nothing.
    measured: (H, W), 0 to 1, how far both measure luminance there rather than interpolate it.
    Where the reference is clipped, a frame agrees that is not clipped and at least as bright.
    """
    found = np.empty(reference.luminance.shape, np.uint8)
    for top in range(0, len(found), _STRIP):
        bottom = min(top + _STRIP, len(found))
        first = max(top - _HALO, 0)
        part = slice(first, min(bottom + _HALO, len(found)))
        own, other = (replace(view, luminance=view.luminance[part]) for view in (reference, frame))
        found[top:bottom] = _agreement(own, other, measured[part])[top - first : bottom - first]
    return found


def unclipped(view: View) -> FloatArray:
    """1 for light well below the limit, 0 for clipped light, (H, W)."""
    if not np.isfinite(view.limit):
        return np.ones_like(view.luminance)
    return np.clip((CLIPPED - view.luminance / np.float32(view.limit)) / np.float32(CLIPPED - _BRIGHT), 0, 1)


def agreement_of(deviation: FloatArray) -> FloatArray:
    """Agreement, 0 to 1, from squared deviations in units of the tolerance."""
    return np.clip((1 / (1 + np.square(deviation)) - _LOW) / (_HIGH - _LOW), 0, 1)


def _agreement(reference: View, frame: View, measured: FloatArray) -> ByteArray:
    seen = np.isfinite(frame.luminance)
    frame = replace(frame, luminance=np.where(seen, frame.luminance, reference.luminance))
    shown, own_shown = unclipped(frame) * seen, unclipped(reference)
    weight = measured * (shown > 0) * (own_shown > 0) + np.float32(1e-4)
    agrees = agreement_of(_deviation(reference, frame, weight.astype(np.float32)))
    agrees = np.where((own_shown == 0) & (frame.luminance > _BRIGHT * reference.limit), 1, agrees)
    return np.rint(255 * minimum_filter(shown * agrees, _FRINGE)).astype(np.uint8)


def _deviation(reference: View, frame: View, weight: FloatArray) -> FloatArray:
    """The squared difference in units of the tolerance, (H, W): the largest of four."""
    r, f = reference.luminance, frame.luminance
    own, other, apart = reference.variance(r), frame.variance(f), f - r
    noise = own + other
    light, shown, power, power_shown, mean, rest = _means(weight, NEIGHBOURHOOD, r, f, r * r, f * f, apart, apart * apart)
    contrast = np.maximum(np.minimum(power - light * light - own, power_shown - shown * shown - other), 0)
    even = np.square(_LIGHT * light)
    tolerated, left = _MEAN**2 * contrast + even, _noise_left(NEIGHBOURHOOD)
    found = mean * mean / (tolerated + DEVIATIONS**2 * left * noise + TINY)
    rest = np.maximum(rest - (1 + DEVIATIONS * (2 * left) ** 0.5) * noise, 0)
    np.maximum(found, rest / (_TEXTURE**2 * contrast + 4 * even + _POWER * noise + TINY), out=found)
    cap = DEVIATIONS * np.sqrt(noise + tolerated)
    mean, contrast = _means(weight, _WIDE, np.clip(apart, -cap, cap), contrast)
    scatter = DEVIATIONS**2 * _noise_left(_WIDE) * noise
    np.maximum(found, mean * mean / (_FAR**2 * contrast + even + scatter + TINY), out=found)
    down, across = (np.asarray(each, np.float32) for each in np.gradient((r + f) / 2))
    dd, da, aa, d, a = _means(weight, _SHIFTED, down * down, down * across, across * across, down * apart, across * apart)
    least = noise / 4 + TINY  # what noise makes of a gradient
    dd, aa = (np.maximum(each - noise / 4, 0) + least for each in (dd, aa))
    explained = (aa * d * d - 2 * da * d * a + dd * a * a) / np.maximum(dd * aa - da * da, 1e-3 * dd * aa)
    scatter = DEVIATIONS**2 * _noise_left(_SHIFTED) * noise
    return np.maximum(found, explained / (_SHIFT**2 * (dd + aa) + even + scatter + TINY))


def _means(weight: FloatArray, sigma: float, *planes: FloatArray) -> list[FloatArray]:
    """Weighted means around each pixel."""
    total = np.float32(1) / smoothed(weight, sigma)
    return [smoothed(weight * plane, sigma) * total for plane in planes]


def _noise_left(sigma: float) -> float:
    """The share of the variance of noise that is left in such a mean."""
    return _GAPS * float(np.square(gaussian(sigma)).sum()) ** 2
