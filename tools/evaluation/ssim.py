"""Structural similarity: Z. Wang et al., "Image quality assessment", IEEE Transactions on Image Processing 13(4), 2004."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError

_RADIUS, _SIGMA = 5, 1.5  # an 11 x 11 Gaussian window
_C1, _C2 = 0.01**2, 0.03**2  # K1, K2 at a dynamic range of 1


def ssim(rendered: FloatArray, truth: FloatArray, border: int = 0) -> float:
    """Mean SSIM index over all channels and over all windows that lie `border` pixels or more inside the frame.

    rendered, truth: (H, W, C), scene units, range 1.
    Raises InputError when the shapes differ or no window fits.
    """
    if rendered.shape != truth.shape or rendered.ndim != 3:
        raise InputError(f"rendered has shape {rendered.shape}, the truth {truth.shape}; expected (rows, columns, channels) alike")
    rows, columns = (size - 2 * border for size in rendered.shape[:2])
    if min(rows, columns) < 2 * _RADIUS + 1:
        window = 2 * _RADIUS + 1
        raise InputError(
            f"a picture of {rendered.shape[1]} x {rendered.shape[0]} pixels has no {window} x {window} window inside a border of "
            f"{border}; at least {2 * border + window} pixels each way are needed"
        )
    inner = (slice(border, border + rows), slice(border, border + columns))
    return float(np.mean([_index(rendered[(*inner, c)], truth[(*inner, c)]) for c in range(rendered.shape[2])]))


def _index(x: FloatArray, y: FloatArray) -> float:
    a, b = x.astype(np.float64), y.astype(np.float64)
    mean_a, mean_b = _local_mean(a), _local_mean(b)
    variance_a, variance_b = _local_mean(a * a) - mean_a**2, _local_mean(b * b) - mean_b**2
    covariance = _local_mean(a * b) - mean_a * mean_b
    likeness = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)  # Eq. 13
    return float((likeness / ((mean_a**2 + mean_b**2 + _C1) * (variance_a + variance_b + _C2))).mean())


def _local_mean(values: DoubleArray) -> DoubleArray:
    """Gaussian mean over each window, (H - 10, W - 10)."""
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(values, _SIGMA, radius=_RADIUS)[_RADIUS:-_RADIUS, _RADIUS:-_RADIUS]
