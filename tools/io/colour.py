"""Published constants and formulas of pictures: the curve of sRGB, the primaries of Display P3, CIE
L*a*b*.
"""

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import DoubleArray, FloatArray
from ...shared.colorimetry import D50

P3_PRIMARIES = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))  # SMPTE EG 432-1

# IEC 61966-2-1: encoded = (1 + OFFSET) linear^(1 / POWER) - OFFSET; below KNEE (linear) or
# ENCODED_KNEE a line of slope SLOPE.
SRGB_POWER, SRGB_OFFSET, SRGB_SLOPE = 2.4, 0.055, 12.92
SRGB_KNEE, SRGB_ENCODED_KNEE = 0.0031308, 0.04045

CIE_EPSILON, CIE_KAPPA = (6 / 29) ** 3, (29 / 3) ** 3  # CIE 15:2018


def encode_srgb(linear: FloatArray) -> FloatArray:
    """Encode linear light of any shape, clipped to 0..1 as sample values of sRGB, 0..1 (IEC
    61966-2-1); float32.
    """
    linear = np.clip(linear, 0.0, 1.0)
    # What is below the knee is replaced: powers of 0 would take ten times as long as others.
    encoded: FloatArray = np.maximum(linear, np.float32(SRGB_KNEE))
    np.power(encoded, np.float32(1 / SRGB_POWER), out=encoded)
    encoded *= np.float32(1 + SRGB_OFFSET)
    encoded -= np.float32(SRGB_OFFSET)
    linear *= np.float32(SRGB_SLOPE)
    # the straight part is the lower one below the knee alone
    return np.minimum(encoded, linear, out=encoded)


def decode_srgb(encoded: NDArray[np.floating]) -> DoubleArray:
    """Decode sample values of sRGB (IEC 61966-2-1) to linear light. Below 0 the straight part
    continues, above 1 the power.
    """
    scale = 1 + SRGB_OFFSET
    power = (np.maximum(encoded, SRGB_ENCODED_KNEE) / scale + SRGB_OFFSET / scale) ** SRGB_POWER
    return np.where(encoded <= SRGB_ENCODED_KNEE, encoded / SRGB_SLOPE, power)


def xyz_to_lab(values: DoubleArray) -> DoubleArray:
    """Convert XYZ (..., 3) relative to D50, white Y = 1 to L*a*b* (..., 3) (CIE 15:2018, 8.2.1)."""
    ratio = np.asarray(values) / D50
    f = np.where(ratio > CIE_EPSILON, np.cbrt(np.maximum(ratio, 0)), (CIE_KAPPA * ratio + 16) / 116)
    fx, fy, fz = np.moveaxis(f, -1, 0)
    return np.stack([116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)], axis=-1)


def lab_to_xyz(lab: DoubleArray) -> DoubleArray:
    """Convert L*a*b* (..., 3) to XYZ (..., 3) relative to D50, white Y = 1; the inverse of
    `xyz_to_lab`.
    """
    lightness, a, b = np.moveaxis(np.asarray(lab, np.float64), -1, 0)
    fy = (lightness + 16) / 116
    f = np.stack([fy + a / 500, fy, fy - b / 200], axis=-1)
    return np.where(f**3 > CIE_EPSILON, f**3, (116 * f - 16) / CIE_KAPPA) * D50
