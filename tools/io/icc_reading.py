"""Reading of ICC profiles: how a picture's values become linear light, and which colours they are.

Supports the profiles that pictures use in practice: RGB with curves and a matrix, and grey with one curve (ICC.1:2022, sections
8.3.3, 8.4.2, 10.6, 10.18, 10.31).
"""

import struct
from contextlib import suppress

import numpy as np

from shared.arrays import DoubleArray
from shared.colorimetry import D50, SRGB_TO_XYZ, as_rows

from .encoding import Curve, Encoding, power_curve, table_curve

_HEADER, _SIGNATURE = 128, slice(36, 40)
_NAME = "its ICC profile"
_PARAMETERS = (1, 3, 4, 5, 7)  # number for each type of parametric curve
_LARGEST, _MOST_KNOTS = 4 << 20, 1 << 16  # bytes of a profile, values of a curve


def read_profile(profile: bytes) -> Encoding | None:
    """Return the encoding that an ICC profile describes; None if it is damaged or of another kind (tables, CMYK, Lab)."""
    with suppress(struct.error, ValueError, KeyError, IndexError, ZeroDivisionError):
        return _parse(profile)
    return None


def _parse(profile: bytes) -> Encoding:
    if profile[_SIGNATURE] != b"acsp" or len(profile) > _LARGEST:
        raise ValueError("not a profile of a picture")
    (count,) = struct.unpack_from(">I", profile, _HEADER)
    entries = struct.iter_unpack(">4sII", profile[_HEADER + 4 : _HEADER + 4 + 12 * min(count, 256)])
    view = memoryview(profile)  # many tags may share the same bytes
    tags = {name: view[start : start + size] for name, start, size in entries}
    if profile[16:20] == b"GRAY":
        return Encoding((_curve(tags[b"kTRC"]),) * 3, SRGB_TO_XYZ, _NAME)
    if profile[16:20] != b"RGB " or profile[20:24] != b"XYZ " or b"A2B0" in tags:
        raise ValueError("not a profile of curves and a matrix")
    matrix = np.stack([_xyz(tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1)
    # Colorants add up to D50 except for rounding, which is corrected so that white stays exactly neutral.
    white = matrix.sum(axis=1)
    if np.abs(white - D50).max() > 0.01 or np.linalg.matrix_rank(matrix) < 3:
        raise ValueError("the colorants do not add up to D50")
    curves = tuple(_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC"))
    return Encoding(curves, as_rows((D50 / white)[:, None] * matrix), _NAME)


def _xyz(data: memoryview) -> DoubleArray:
    return np.array(struct.unpack_from(">3i", data, 8)) / 65536


def _curve(data: memoryview) -> Curve:
    match data[:4]:
        case b"curv":
            (count,) = struct.unpack_from(">I", data, 8)
            if count > _MOST_KNOTS:
                raise ValueError("not the curve of a picture")
            if count == 0:
                return power_curve(1.0)
            values = np.frombuffer(data, ">u2", count, 12)
            if count == 1:
                return power_curve(_plausible(values[0] / 256))
            return table_curve(values / 65535)
        case b"para":
            (kind,) = struct.unpack_from(">H", data, 8)
            return _parametric(*(np.array(struct.unpack_from(f">{_PARAMETERS[kind]}i", data, 12)) / 65536).tolist())
    raise ValueError("not a curve")


def _parametric(
    gamma: float, a: float = 1.0, b: float = 0.0, c: float | None = None, d: float | None = None, e: float = 0.0, f: float = 0.0
) -> Curve:
    """Return the curve of ICC.1:2022, table 68: (a x + b)^gamma + e from d on, c x + f below d; types 1 and 2 take that form."""
    _plausible(gamma)
    if d is None:  # types 0 to 2: below -b / a a constant, which is their third parameter, or 0
        e = f = c or 0.0
        c, d = 0.0, -b / a
    slope, knee = c or 0.0, d
    return lambda x: np.where(x >= knee, np.maximum(a * x + b, 0) ** gamma + e, slope * x + f)


def _plausible(gamma: float) -> float:
    if not 0.1 < gamma < 10:
        raise ValueError("not the exponent of a picture")
    return float(gamma)
