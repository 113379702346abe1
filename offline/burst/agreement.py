"""How far a frame agrees with the reference at each of its pixels, beyond noise: what moved, was hidden or changed does not."""

import numpy as np

from shared.arrays import ByteArray, FloatArray
from shared.calibration import NoiseModel

from ..gaussian import gaussian
from ..kernels.smoothing import smooth

_WIDTH = 1.5  # pixels: standard deviation of the neighbourhood over which differences are judged
_MEAN, _TEXTURE = 0.3, 0.6  # difference that is tolerated, as a share of the local contrast: of means, and of single pixels
_LIGHT = 0.01  # and of the light: what a changed exposure or a cloud may do
_DEVIATIONS = 3.0
_STEEPNESS = 2
_CLIPPED = 0.98


def agreement(
    reference: FloatArray, frame: FloatArray, noise: tuple[NoiseModel | None, NoiseModel | None], limit: float
) -> ByteArray:
    """0 to 255 at each pixel, uint8 (H, W): how far to trust the frame there.

    reference, frame: (H, W), luminance, scene units of the reference; the frame as the reference would see it, NaN where it sees
        nothing.
    noise: of the two, in these units; None: there is none.
    limit: scene units from which on the frame is clipped.
    """
    seen = np.isfinite(frame) & (frame < _CLIPPED * limit)
    difference = np.where(seen, frame - reference, 0)
    own, other = (_variance(reference, model) for model in noise)
    light = np.maximum(smoothed(reference, _WIDTH), 0)
    contrast = np.maximum(smoothed(np.square(reference - light), _WIDTH) - own, 0)
    mean, power = smoothed(difference, _WIDTH), smoothed(np.square(difference), _WIDTH)
    kept = float(np.square(gaussian(_WIDTH)).sum()) ** 2  # of the variance of noise, after smoothing
    both = own + other
    tolerance = _MEAN**2 * contrast + np.square(_LIGHT * light)
    apart = np.square(mean) / (tolerance + _DEVIATIONS**2 * kept * both + 1e-12)
    rest = np.maximum(power - both * (1 + _DEVIATIONS * (2 * kept) ** 0.5), 0)
    rough = rest / (_TEXTURE**2 * contrast + np.square(2 * _LIGHT * light) + 0.3 * both + 1e-12)
    trust = seen / (1 + np.maximum(apart, rough) ** _STEEPNESS)
    return np.rint(255 * trust).astype(np.uint8)


def smoothed(plane: FloatArray, sigma: float) -> FloatArray:
    """A plane convolved with a Gaussian of `sigma` pixels, mirrored at the border; float32 (H, W)."""
    found = np.empty(plane.shape, np.float32)
    smooth(np.ascontiguousarray(plane, np.float32), gaussian(sigma), found)
    return found


def _variance(light: FloatArray, noise: NoiseModel | None) -> FloatArray | float:
    return noise.shot[-1] * np.maximum(light, 0) + noise.read[-1] ** 2 if noise else 0.0
