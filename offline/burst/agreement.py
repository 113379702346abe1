"""How far a frame agrees with the reference at each of its pixels, beyond noise: what moved, was hidden or changed does not.

Only where both measure luminance are they compared. Both sample the light finer than their pixels show it, each at other places, so
edges and texture differ even where nothing has changed: differences are tolerated in proportion to the contrast that both have.
Four things tell of a change: another mean; differences as large as the texture; many small differences of one sign over a wide
neighbourhood (a pale thing in noise); and differences that a shift explains (a branch that sways by a part of a pixel).
"""

import numpy as np
from scipy.ndimage import minimum_filter

from shared.arrays import ByteArray, FloatArray
from shared.calibration import NoiseModel

from ..gaussian import gaussian
from ..kernels.agreeing import MOVED, NEAR, compare_far, compare_near, products
from .frames import smoothed

_NEAR, _MOVED, _WIDE = 1.5, 2.0, 5.0  # pixels: standard deviations of the neighbourhoods
_MEAN, _TEXTURE, _FAR = 0.3, 0.6, 0.1  # difference that is tolerated, as a share of the contrast
_SHIFT = 0.2  # pixels
_LIGHT = 0.01  # of the light: what a changed exposure or a cloud may do
_DEVIATIONS, _CAP = 3.0, 3.0
_LOW, _HIGH = 0.3, 0.8  # raw trust that counts as none, and as all: half-trusted ghosts of many frames would add up
_FRINGE = 3  # pixels: size of the neighbourhood that has to agree as a whole
_BRIGHT, _CLIPPED = 0.92, 0.98  # of the limit: light that counts less, and not at all
_GAPS = np.float32(1.2)  # by which pixels that do not measure luminance raise the noise of a mean
_STRIP, _HALO = 256, 24  # rows that are judged at a time, and around them

Limits = tuple[float, float]
"""Scene units of the reference from which on it, and the frame, are clipped."""


def agreement(
    reference: FloatArray,
    frame: FloatArray,
    measured: FloatArray,
    noise: tuple[NoiseModel | None, NoiseModel | None],
    limits: Limits,
) -> ByteArray:
    """0 to 255 at each pixel, uint8 (H, W): how far to trust the frame there.

    reference, frame: (H, W), luminance, scene units of the reference; the frame as the reference would see it, NaN where it sees
        nothing.
    measured: (H, W), 0 to 1, how far both measure luminance there rather than interpolate it.
    noise: of the two, in these units; None: there is none.
    Where the reference is clipped nothing is known against a frame that is not, and is as bright at least.
    """
    trust = np.empty(reference.shape, np.uint8)
    for top in range(0, len(reference), _STRIP):
        bottom = min(top + _STRIP, len(reference))
        first = max(top - _HALO, 0)
        part = slice(first, min(bottom + _HALO, len(reference)))
        found = _trust(reference[part], frame[part], measured[part], noise, limits)
        trust[top:bottom] = found[top - first : bottom - first]
    return trust


def unclipped(light: FloatArray, limit: float) -> FloatArray:
    """1 for light well below the limit, 0 for clipped light."""
    if not np.isfinite(limit):
        return np.ones_like(light)
    shown: FloatArray = np.clip((_CLIPPED - light / np.float32(limit)) / np.float32(_CLIPPED - _BRIGHT), 0, 1)
    return shown


def sure(doubt: FloatArray) -> FloatArray:
    """Trust, 0 to 1, given squared differences in units of what is tolerated."""
    trust: FloatArray = np.clip((1 / (1 + np.square(doubt)) - _LOW) / (_HIGH - _LOW), 0, 1)
    return trust


def _trust(
    reference: FloatArray,
    frame: FloatArray,
    measured: FloatArray,
    noise: tuple[NoiseModel | None, NoiseModel | None],
    limits: Limits,
) -> ByteArray:
    seen = np.isfinite(frame)
    frame = np.where(seen, frame, reference)
    shown, own_shown = unclipped(frame, limits[1]) * seen, unclipped(reference, limits[0])
    weight = measured * (shown > 0) * (own_shown > 0) + np.float32(1e-4)
    raw = _compared(np.ascontiguousarray(reference), frame, weight.astype(np.float32), noise)
    trust = sure(raw)
    trust = np.where((own_shown == 0) & (frame > _BRIGHT * limits[0]), 1, trust)
    result: ByteArray = np.rint(255 * minimum_filter(shown * trust, _FRINGE)).astype(np.uint8)
    return result


def _compared(
    reference: FloatArray, frame: FloatArray, weight: FloatArray, noise: tuple[NoiseModel | None, NoiseModel | None]
) -> FloatArray:
    """The squared difference in units of what is tolerated."""
    shape = reference.shape
    own, other = ((each.shot[-1], each.read[-1] ** 2) if each else (0.0, 0.0) for each in noise)
    model = *own, *other
    near, moved = np.empty((NEAR, *shape), np.float32), np.empty((MOVED, *shape), np.float32)
    products(reference, frame, weight, near, moved)
    near, moved = _means(near, _NEAR), _means(moved, _MOVED)
    kept = _kept(_NEAR)
    limits = _MEAN**2, _TEXTURE**2, _LIGHT, _DEVIATIONS**2 * kept, 1 + _DEVIATIONS * (2 * kept) ** 0.5, 0.3, _CAP
    wide, found = np.empty((3, *shape), np.float32), np.empty(shape, np.float32)
    compare_near(reference, frame, weight, near, model, limits, wide, found)
    far = _FAR**2, _LIGHT, _DEVIATIONS**2 * _kept(_WIDE), _SHIFT**2, _DEVIATIONS**2 * _kept(_MOVED)
    compare_far(reference, frame, near, _means(wide, _WIDE), moved, model, far, found)
    return found


def _means(planes: FloatArray, sigma: float) -> FloatArray:
    """Sums around each pixel, of a weight and of what is weighted by it."""
    return np.stack([smoothed(plane, sigma) for plane in planes])


def _kept(sigma: float) -> float:
    """The share of the variance of noise that a mean keeps."""
    return float(_GAPS * np.float32(np.square(gaussian(sigma)).sum()) ** 2)
