"""The colour difference CIEDE2000, and the derivative of L*a*b*."""

import numpy as np

from ...shared.arrays import DoubleArray
from ...shared.colorimetry import D50
from .colour import CIE_EPSILON, CIE_KAPPA


def lab_slopes(xyz_values: DoubleArray) -> DoubleArray:
    """Return the derivative of L*a*b* with respect to XYZ at colours (N, 3): (N, 3, 3)."""
    ratio = np.maximum(np.asarray(xyz_values) / D50, 1e-6)
    slope = np.where(ratio > CIE_EPSILON, np.cbrt(ratio) / (3 * ratio), CIE_KAPPA / 116) / D50
    lightness = np.array([[0, 116, 0], [500, -500, 0], [0, 200, -200]], float)
    return lightness[None] * slope[:, None, :]


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
    hue = np.where(
        grey, total, np.where(wrapped, (total + np.where(total < 360, 360, -360)) / 2, total / 2)
    )
    weight = (
        1
        - 0.17 * np.cos(np.radians(hue - 30))
        + 0.24 * np.cos(np.radians(2 * hue))
        + 0.32 * np.cos(np.radians(3 * hue + 6))
        - 0.20 * np.cos(np.radians(4 * hue - 63))
    )  # T, Eq. 15
    rotation = (
        -np.sin(np.radians(60 * np.exp(-(((hue - 275) / 25) ** 2))))
        * 2
        * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    )
    s_lightness = 1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2)  # Eq. 18
    # Eqs. 19, 20
    by_chroma, by_hue = d_chroma / (1 + 0.045 * chroma), d_hue / (1 + 0.015 * chroma * weight)
    # Eq. 22
    squared = (
        (d_lightness / s_lightness) ** 2 + by_chroma**2 + by_hue**2 + rotation * by_chroma * by_hue
    )
    return np.sqrt(np.maximum(squared, 0))
