"""Published constants and formulas of pictures: the curve of sRGB, the primaries of Display P3, CIE
L*a*b*, its derivative, and the colour difference CIEDE2000.
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


def lab_slopes(xyz_values: DoubleArray) -> DoubleArray:
    """Return the derivative of L*a*b* with respect to XYZ at colours (N, 3): (N, 3, 3)."""
    ratio = np.maximum(np.asarray(xyz_values) / D50, 1e-6)
    slope = np.where(ratio > CIE_EPSILON, np.cbrt(ratio) / (3 * ratio), CIE_KAPPA / 116) / D50
    lightness = np.array([[0, 116, 0], [500, -500, 0], [0, 200, -200]], float)
    return lightness[None] * slope[:, None, :]


def _cosine(degrees: DoubleArray) -> DoubleArray:
    return np.cos(np.radians(degrees))


def delta_e_2000(first: DoubleArray, second: DoubleArray) -> DoubleArray:
    """Return CIEDE2000 between L*a*b* colours (..., 3), with weights 1.

    G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 color-difference formula: implementation notes,
    supplementary test data, and mathematical observations", Color Research and Application 30(1),
    2005; equation numbers are theirs.
    """
    lightness1, a1, b1 = np.moveaxis(np.asarray(first, np.float64), -1, 0)
    lightness2, a2, b2 = np.moveaxis(np.asarray(second, np.float64), -1, 0)
    mean_chroma = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2  # Eq. 3
    stretch = 1.5 - 0.5 * np.sqrt(mean_chroma**7 / (mean_chroma**7 + 25.0**7))  # 1 + G, Eq. 4
    chroma1, chroma2 = np.hypot(a1 * stretch, b1), np.hypot(a2 * stretch, b2)  # Eq. 6
    # Eq. 7; 0 for grey
    hue1, hue2 = (np.degrees(np.arctan2(b, a * stretch)) % 360 for a, b in ((a1, b1), (a2, b2)))
    grey = chroma1 * chroma2 == 0
    turn = np.where(grey, 0.0, (hue2 - hue1 + 180) % 360 - 180)  # Eq. 10
    turn = np.where((turn == -180) & (hue2 > hue1), 180.0, turn)
    d_lightness, d_chroma = lightness2 - lightness1, chroma2 - chroma1  # Eqs. 8, 9
    d_hue = 2 * np.sqrt(chroma1 * chroma2) * np.sin(np.radians(turn) / 2)  # Eq. 11
    lightness, chroma = (lightness1 + lightness2) / 2, (chroma1 + chroma2) / 2  # Eqs. 12, 13
    total = hue1 + hue2
    wrapped = np.abs(hue1 - hue2) > 180
    # Eq. 14
    average = np.where(wrapped, (total + np.where(total < 360, 360, -360)) / 2, total / 2)
    hue = np.where(grey, total, average)
    # T, Eq. 15
    weight = 1 - 0.17 * _cosine(hue - 30) + 0.24 * _cosine(2 * hue) + 0.32 * _cosine(3 * hue + 6)
    weight = weight - 0.20 * _cosine(4 * hue - 63)
    angle = 60 * np.exp(-(((hue - 275) / 25) ** 2))  # 2 Delta theta, Eq. 16
    weight_of_chroma = 2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))  # R_C, Eq. 17
    rotation = -np.sin(np.radians(angle)) * weight_of_chroma  # Eq. 21
    s_lightness = 1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2)  # Eq. 18
    # Eqs. 19, 20
    by_chroma, by_hue = d_chroma / (1 + 0.045 * chroma), d_hue / (1 + 0.015 * chroma * weight)
    # Eq. 22
    by_lightness, turned = d_lightness / s_lightness, rotation * by_chroma * by_hue
    squared = by_lightness**2 + by_chroma**2 + by_hue**2 + turned
    return np.sqrt(np.maximum(squared, 0))
