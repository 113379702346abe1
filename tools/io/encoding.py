"""Encoding of the values of a picture, as its file declares: curves and primaries, by names or in
an ICC profile, which Little CMS reads; and the ICC profiles of the pictures that are written.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import DoubleArray, FloatArray, strips
from ...shared.colorimetry import D50, SRGB_TO_XYZ, Matrix, as_rows, primaries_to_xyz
from ...shared.errors import InputError
from ...shared.tiff_reading import StoredField, read_directories
from .colour import P3_PRIMARIES, decode_srgb
from .damage import guarded

Curve = Callable[[DoubleArray], DoubleArray]  # encoded values, 0..1 -> linear light, 0..1

_COLOR_SPACE, _INTEROPERABILITY_INDEX = 40961, 1  # Exif tags
_LINEAR = 2e-3  # largest deviation from the identity of a curve that is called linear
_BT2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
_REC_2020 = as_rows(primaries_to_xyz(_BT2020))  # to XYZ (D50)
# H.273, table 2. 5 to 7: BT.601, of 625 and of 525 lines.
_CODED_SPACES = {
    1: np.array(SRGB_TO_XYZ),
    5: primaries_to_xyz(((0.640, 0.330), (0.290, 0.600), (0.150, 0.060))),
    **dict.fromkeys((6, 7), primaries_to_xyz(((0.630, 0.340), (0.310, 0.595), (0.155, 0.070)))),
    9: primaries_to_xyz(_BT2020),
    11: primaries_to_xyz(P3_PRIMARIES, (0.314, 0.351)),
    12: primaries_to_xyz(P3_PRIMARIES),
}


@dataclass(frozen=True)
class Encoding:
    """Encoding of the values of a picture.

    Attributes
    ----------
    curves : tuple[Curve, ...]
        One per channel, from encoded values to linear light, both 0..1; () = not declared.
    to_xyz : Matrix
        (3, 3), linear RGB to XYZ (D50 white).
    name : str
        For the user.
    profile : bytes
        An ICC profile of tables, in place of the curves; b"" = none.
    """

    curves: tuple[Curve, ...]
    to_xyz: Matrix
    name: str
    profile: bytes = b""

    @property
    def linear(self) -> bool:
        """True if the values are linear light already, for all that is declared."""
        ramp = np.linspace(0, 1, 256)
        return all(float(np.abs(curve(ramp) - ramp).max()) < _LINEAR for curve in self.curves)


def power_curve(gamma: float) -> Curve:
    """Return the curve that raises encoded values to the power of `gamma`."""
    return lambda encoded: encoded**gamma


def table_curve(table: DoubleArray) -> Curve:
    """Return the curve through equally spaced values, linear light from 0 to 1."""
    knots = np.linspace(0, 1, len(table))
    return lambda encoded: np.interp(encoded, knots, table)


SRGB = Encoding((decode_srgb,) * 3, SRGB_TO_XYZ, "sRGB")
LINEAR = Encoding((power_curve(1.0),) * 3, SRGB_TO_XYZ, "linear")
# Adobe RGB (1998), 4.3.1.1 and 4.3.4.2
_ADOBE_TO_XYZ = as_rows(primaries_to_xyz(((0.640, 0.330), (0.210, 0.710), (0.150, 0.060))))
ADOBE_RGB = Encoding((power_curve(563 / 256),) * 3, _ADOBE_TO_XYZ, "Adobe RGB")


def space_of(corners: Sequence[float]) -> Matrix | None:
    """Return the matrix to XYZ (D50) of a space: x and y of red, green, blue and white; None if
    there can be no such space.
    """
    with np.errstate(all="ignore"):
        try:
            *primaries, white = ((x, y) for x, y in np.reshape(corners, (4, 2)).tolist())
            matrix = primaries_to_xyz(primaries, white)
        except (ArithmeticError, ValueError):  # NumPy's error of a singular matrix is a ValueError
            return None
    return as_rows(matrix) if np.isfinite(matrix).all() and np.linalg.cond(matrix) < 1e4 else None


def exif_encoding(exif: IO[bytes], notes: list[str]) -> Encoding | None:
    """Return the encoding that a block of Exif declares; None without one.

    ColorSpace is 1 for sRGB and 65535 for any other space (CIPA DC-008, 4.6.6). Of those, cameras
    have Adobe RGB, and mark it by the interoperability index R03 (DCF 2.0, CIPA DC-009); some write
    2 for it.

    notes: gets a remark for the user.
    """
    stored = read_directories(exif, {_COLOR_SPACE, _INTEROPERABILITY_INDEX})
    space = stored.exif.get(_COLOR_SPACE, StoredField(0)).numbers[:1]
    option = stored.interoperability.get(_INTEROPERABILITY_INDEX, StoredField(0)).data[:3]
    if space == (1,):
        return SRGB
    if space == (2,) or option == b"R03":
        return ADOBE_RGB
    if space and option != b"R98":
        unnamed = "the colours are not those of sRGB, and not which they are"
        notes.append(f"Exif says that {unnamed}; sRGB's are assumed")
    return None


def coded_encoding(code: bytes, peak: int) -> Encoding | None:
    """Return the encoding that code points of H.273 declare; None for one that is not read. The
    curves of PQ and HLG raise InputError.

    code: primaries, transfer (tables 2 and 3), matrix, which is 0 for RGB, and whether the range is
    full; in the narrow range black is 16, white 235 of 256 steps. peak: the largest sample.
    """
    primaries, transfer, matrix, full = code if len(code) == 4 else bytes(4)
    curve, to_xyz = _CODED_CURVES.get(transfer), _CODED_SPACES.get(primaries)
    if curve is None or to_xyz is None or matrix or full > 1:
        return None
    if not full:
        curve = _narrow(curve, (peak + 1) / 256 / peak)
    name = f"primaries {primaries} and transfer {transfer} of H.273"
    return Encoding((curve,) * 3, as_rows(to_xyz), name)


def _narrow(curve: Curve, step: float) -> Curve:
    """The curve of the narrow range. step: one of 256, as a fraction of the largest value."""
    return lambda encoded: curve(np.maximum((encoded - 16 * step) / (219 * step), 0))


def _bt709(encoded: DoubleArray) -> DoubleArray:
    """BT.709, item 1.2, inverted."""
    return np.where(encoded < 4.5 * 0.018, encoded / 4.5, ((encoded + 0.099) / 1.099) ** (1 / 0.45))


def _refused(name: str) -> Curve:
    """A curve that is not read."""

    def curve(encoded: DoubleArray) -> DoubleArray:
        remedy = "save it as sRGB, or as linear light in an EXR or a TIFF"
        raise InputError(f"its values are encoded in {name}; {remedy}")

    return curve


# H.273, table 3.
_CODED_CURVES: dict[int, Curve] = {
    **dict.fromkeys((1, 6, 14, 15), _bt709),
    4: power_curve(2.2),
    5: power_curve(2.8),
    8: power_curve(1.0),
    13: decode_srgb,
    16: _refused("PQ"),
    18: _refused("HLG"),
}

_PROFILE_NAME = "its ICC profile"
_LARGEST_PROFILE = 4 << 20  # bytes
_CURVE_CODES = 1 << 16  # at which a curve is read
_ADDS = 2e-3  # of white: profiles of curves and a matrix differ less from sums of their channels


@cache
def icc_profile(space: str) -> bytes:
    """Return the profile of a space in `SPACES`; always the same bytes."""
    return Path(__file__).with_name("profiles").joinpath(f"{space}.icc").read_bytes()


def profile_encoding(profile: bytes, notes: list[str]) -> Encoding | None:
    """Return the encoding that an embedded ICC profile declares; None for b"", and for one that is
    damaged, or of no RGB or grey picture.

    notes: gets a remark for the user.
    """
    try:
        if profile:
            return _grey_profile(profile) if profile[16:20] == b"GRAY" else _rgb_profile(profile)
    except InputError:
        notes.append("the embedded colour profile is damaged; it is ignored")
    return None


def through_tables(pixels: NDArray[Any], peak: int, profile: bytes) -> FloatArray:
    """Convert codes (H, W, 1 or 3) by a profile of tables to linear light in BT.2020, float32 (H,
    W, 3).

    `peak` is the code that stands for 1.0. White is 1; nothing is negative.
    """
    linear: FloatArray = np.empty((*pixels.shape[:2], 3), np.float32)
    back = np.linalg.inv(np.array(_REC_2020)).T
    for rows in strips(len(pixels)):
        codes = np.broadcast_to(pixels[rows], linear[rows].shape)
        linear[rows] = np.maximum(_profile_to_xyz(codes / peak, profile) @ back, 0)
    return linear


def _grey_profile(profile: bytes) -> Encoding:
    ramp = np.linspace(0, 1, _CURVE_CODES)[None]
    curve = _profile_to_xyz(ramp, profile, "gray")[0, :, 1]
    return Encoding((table_curve(curve / curve[-1]),) * 3, SRGB_TO_XYZ, _PROFILE_NAME)


def _rgb_profile(profile: bytes) -> Encoding:
    ramps = np.linspace(0, 1, _CURVE_CODES)[:, None] * np.eye(3)[:, None]  # of each channel alone
    converted = _profile_to_xyz(ramps, profile)
    matrix = converted[:, -1].T
    tables = Encoding(LINEAR.curves, _REC_2020, _PROFILE_NAME, profile=profile)
    white = matrix.sum(axis=1)
    if np.abs(white - D50).max() > 0.01 or np.linalg.matrix_rank(matrix) < 3:
        return tables
    columns = zip(converted, matrix.T, strict=True)
    curves = [ramp @ column / (column @ column) for ramp, column in columns]
    colours = np.random.default_rng(0).integers(0, _CURVE_CODES, (1, 64, 3))
    planes = [curve[colours[..., channel]] for channel, curve in enumerate(curves)]
    sums = np.stack(planes, axis=-1) @ matrix.T
    if np.abs(sums - _profile_to_xyz(colours / (_CURVE_CODES - 1), profile)).max() > _ADDS:
        return tables
    # Colorants add up to D50 except for rounding, which is corrected so that white stays exactly
    # neutral.
    to_xyz = as_rows((D50 / white)[:, None] * matrix)
    return Encoding(tuple(map(table_curve, curves)), to_xyz, _PROFILE_NAME)


def _profile_to_xyz(values: DoubleArray, profile: bytes, kind: str = "rgb") -> DoubleArray:
    """Convert values 0..1 (H, W, C) to XYZ (H, W, 3), relative to D50. Raises InputError for
    a damaged profile, and for that of another kind of picture.
    """
    import imagecodecs

    if len(profile) > _LARGEST_PROFILE:
        raise InputError("its colour profile is longer than that of any picture")
    spaces: dict[str, Any] = {"colorspace": kind, "outcolorspace": "xyz", "outdtype": "f8"}
    codes, xyz = np.asarray(values, np.float64), imagecodecs.cms_profile("xyz")
    with guarded():
        converted: DoubleArray = imagecodecs.cms_transform(codes, profile, xyz, intent=1, **spaces)
    if not np.isfinite(converted).all():
        raise InputError("its colour profile has no colours of a picture")
    return converted
