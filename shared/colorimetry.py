"""Published constants and formulas of colour: white points, chromatic adaptation, RGB primaries, the sRGB curve, L*a*b*."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import DoubleArray, FloatArray

Matrix = tuple[tuple[float, ...], ...]  # a tuple per row, as frozen dataclasses keep it

D50 = np.array([0.9642, 1.0, 0.8249])  # CIE XYZ of the profile connection space, ICC.1:2022, 7.2.16
D65_XY = (0.3127, 0.3290)  # ITU-R BT.709, also of IEC 61966-2-1
# Bradford's cone responses: ICC.1:2022, annex E
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

SRGB_PRIMARIES = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))  # IEC 61966-2-1, table 1
P3_PRIMARIES = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))  # SMPTE EG 432-1

# IEC 61966-2-1: encoded = (1 + OFFSET) linear^(1 / POWER) - OFFSET; below KNEE (linear) or ENCODED_KNEE a line of slope SLOPE.
SRGB_POWER, SRGB_OFFSET, SRGB_SLOPE = 2.4, 0.055, 12.92
SRGB_KNEE, SRGB_ENCODED_KNEE = 0.0031308, 0.04045

CIE_EPSILON, CIE_KAPPA = (6 / 29) ** 3, (29 / 3) ** 3  # CIE 15:2018


def xyz(x: float, y: float) -> DoubleArray:
    """CIE XYZ with Y = 1 of the chromaticity (x, y); float64 (3,)."""
    return np.array([x / y, 1.0, (1 - x - y) / y])


def adaptation(source: DoubleArray, destination: DoubleArray = D50) -> DoubleArray:
    """Matrix of the linear Bradford adaptation of XYZ from one white to another (ICC.1:2022, annex E); float64 (3, 3)."""
    gain: DoubleArray = (BRADFORD @ destination) / (BRADFORD @ source)
    return np.linalg.solve(BRADFORD, gain[:, None] * BRADFORD)


def primaries_to_xyz(primaries: Sequence[tuple[float, float]], white: tuple[float, float] = D65_XY) -> DoubleArray:
    """Matrix from linear RGB to XYZ relative to D50 (SMPTE RP 177, then Bradford); float64 (3, 3). RGB (1, 1, 1) becomes D50.

    primaries: chromaticities (x, y) of red, green and blue.
    white: chromaticity (x, y) of RGB (1, 1, 1).
    Raises numpy.linalg.LinAlgError when the primaries lie on a line.
    """
    columns = np.stack([xyz(*primary) for primary in primaries], axis=1)
    source = xyz(*white)
    return adaptation(source) @ (columns * np.linalg.solve(columns, source))


def as_rows(matrix: NDArray[np.floating]) -> Matrix:
    """A matrix as nested tuples, which frozen dataclasses can keep."""
    return tuple(tuple(row) for row in matrix.tolist())


def encode_srgb(linear: FloatArray) -> FloatArray:
    """Linear light of any shape, clipped to 0..1 -> sample values of sRGB, 0..1 (IEC 61966-2-1); float32."""
    linear = np.clip(linear, 0.0, 1.0)
    # What is below the knee is replaced: powers of 0 would take ten times as long as others.
    encoded: FloatArray = np.maximum(linear, np.float32(SRGB_KNEE))
    np.power(encoded, np.float32(1 / SRGB_POWER), out=encoded)
    encoded *= np.float32(1 + SRGB_OFFSET)
    encoded -= np.float32(SRGB_OFFSET)
    linear *= np.float32(SRGB_SLOPE)
    return np.minimum(encoded, linear, out=encoded)  # the straight part is the lower one below the knee alone


def decode_srgb(encoded: NDArray[np.floating]) -> DoubleArray:
    """Sample values of sRGB, 0..1 (IEC 61966-2-1) -> linear light 0..1. Below 0 the straight part continues, above 1 the power."""
    scale = 1 + SRGB_OFFSET
    power = (np.maximum(encoded, SRGB_ENCODED_KNEE) / scale + SRGB_OFFSET / scale) ** SRGB_POWER
    return np.where(encoded <= SRGB_ENCODED_KNEE, encoded / SRGB_SLOPE, power)


def xyz_to_lab(values: DoubleArray) -> DoubleArray:
    """XYZ (..., 3) relative to D50, white Y = 1 -> L*a*b* (..., 3) (CIE 15:2018, 8.2.1)."""
    ratio = np.asarray(values) / D50
    f = np.where(ratio > CIE_EPSILON, np.cbrt(np.maximum(ratio, 0)), (CIE_KAPPA * ratio + 16) / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def lab_to_xyz(lab: DoubleArray) -> DoubleArray:
    """L*a*b* (..., 3) -> XYZ (..., 3) relative to D50, white Y = 1; the inverse of `xyz_to_lab`."""
    lightness, a, b = np.moveaxis(np.asarray(lab, np.float64), -1, 0)
    fy = (lightness + 16) / 116
    f = np.stack([fy + a / 500, fy, fy - b / 200], axis=-1)
    return np.where(f**3 > CIE_EPSILON, f**3, (116 * f - 16) / CIE_KAPPA) * D50


SRGB_TO_XYZ = as_rows(primaries_to_xyz(SRGB_PRIMARIES))


def among(matrix: ArrayLike, channels: str) -> DoubleArray:
    """A matrix (3, 3) of red, green and blue for channels that have these three among them; float64 (3, C).

    The other channels have no colour.

    >>> from shared.colorimetry import among
    >>> among([[1, 2, 3]] * 3, "GNRB")[0].tolist()
    [2.0, 0.0, 1.0, 3.0]
    """
    wide = np.zeros((3, len(channels)))
    wide[:, [channels.index(letter) for letter in "RGB"]] = matrix
    return wide


def nominal_to_xyz(channels: str, neutral: Sequence[float] | None) -> DoubleArray:
    """The matrix from channels, R, G and B among them, to XYZ (D50) if those three have the primaries of sRGB; float64 (3, C).

    neutral: what white reads in each channel; None = the same. The primaries belong to balanced channels, where white reads 1.
    """
    balance = 1.0 if neutral is None else max(neutral) / np.array(neutral)
    return np.asarray(among(SRGB_TO_XYZ, channels) * balance)
