"""ICC profiles: those of the pictures that are written, and those that pictures bring along, read
by Little CMS.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import DoubleArray, FloatArray, strips
from ...shared.colorimetry import D50, SRGB_TO_XYZ, as_rows
from ...shared.errors import InputError
from .damage import guarded
from .encoding import LINEAR, REC_2020, Encoding, table_curve

_NAME = "its ICC profile"
_LARGEST_PROFILE = 4 << 20  # bytes
_CODES = 1 << 16  # at which a curve is read
_ADDS = 2e-3  # of white: profiles of curves and a matrix differ less from sums of their channels


@cache
def icc_profile(space: str) -> bytes:
    """Return the profile of a space in `SPACES`; always the same bytes."""
    return Path(__file__).with_name("profiles").joinpath(f"{space}.icc").read_bytes()


def read_profile(profile: bytes) -> Encoding | None:
    """Return the encoding that a profile describes; None if it is damaged, or of no RGB or grey
    picture.
    """
    try:
        return _grey(profile) if profile[16:20] == b"GRAY" else _rgb(profile)
    except InputError:
        return None


def through_tables(pixels: NDArray[Any], peak: int, profile: bytes) -> FloatArray:
    """Convert codes (H, W, 1 or 3) by a profile of tables to linear light in BT.2020, float32 (H,
    W, 3).

    `peak` is the code that stands for 1.0. White is 1; nothing is negative.
    """
    linear: FloatArray = np.empty((*pixels.shape[:2], 3), np.float32)
    back = np.linalg.inv(np.array(REC_2020)).T
    for rows in strips(len(pixels)):
        codes = np.broadcast_to(pixels[rows], linear[rows].shape)
        linear[rows] = np.maximum(_xyz(codes / peak, profile) @ back, 0)
    return linear


def _grey(profile: bytes) -> Encoding:
    ramp = np.linspace(0, 1, _CODES)[None]
    curve = _xyz(ramp, profile, "gray")[0, :, 1]
    return Encoding((table_curve(curve / curve[-1]),) * 3, SRGB_TO_XYZ, _NAME)


def _rgb(profile: bytes) -> Encoding:
    ramps = np.linspace(0, 1, _CODES)[:, None] * np.eye(3)[:, None]  # of each channel alone
    converted = _xyz(ramps, profile)
    matrix = converted[:, -1].T
    tables = Encoding(LINEAR.curves, REC_2020, _NAME, profile=profile)
    white = matrix.sum(axis=1)
    if np.abs(white - D50).max() > 0.01 or np.linalg.matrix_rank(matrix) < 3:
        return tables
    columns = zip(converted, matrix.T, strict=True)
    curves = [ramp @ column / (column @ column) for ramp, column in columns]
    colours = np.random.default_rng(0).integers(0, _CODES, (1, 64, 3))
    planes = [curve[colours[..., channel]] for channel, curve in enumerate(curves)]
    sums = np.stack(planes, axis=-1) @ matrix.T
    if np.abs(sums - _xyz(colours / (_CODES - 1), profile)).max() > _ADDS:
        return tables
    # Colorants add up to D50 except for rounding, which is corrected so that white stays exactly
    # neutral.
    to_xyz = as_rows((D50 / white)[:, None] * matrix)
    return Encoding(tuple(map(table_curve, curves)), to_xyz, _NAME)


def _xyz(values: DoubleArray, profile: bytes, kind: str = "rgb") -> DoubleArray:
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
