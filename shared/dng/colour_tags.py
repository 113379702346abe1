"""The colour fields of a DNG: matrices from XYZ to camera RGB, and the reading of white."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..colorimetry import D50, D65_XY, SRGB_TO_XYZ, adaptation, xyz
from ..errors import InputError
from ..tiff import Fields, FieldType
from .tags import Light, Tag


def colour_fields(camera_to_xyz: ArrayLike | None, neutral: ArrayLike | None, panchromatic: ArrayLike | None = None) -> Fields:
    """Fields ColorMatrix, CalibrationIlluminant (1: D50, 2: D65) and AsShotNeutral of a camera with red, green and blue.

    Both matrices describe the same camera. DNG asks for the one under D50, which the calibration has. But LibRaw, darktable and
    similar programs take any matrix for one under D65, and show saturated colours wrong by a tenth unless they find such a matrix.

    camera_to_xyz: 3 x 3, camera RGB -> XYZ (D50 white); None = a nominal matrix, because DNG requires one: sRGB primaries.
    neutral: reading of white in the 3 channels; None = the reading that the matrix maps to D50.
    panchromatic: the 3 weights of Eq. 7 if the file has a panchromatic plane; it comes last and reads the weighted sum.
    Raises InputError when the matrix cannot be inverted, or the neutral is not three positive numbers.
    """
    seen = None if neutral is None else np.asarray(neutral, np.float64)
    if seen is not None and not (seen.shape == (3,) and np.isfinite(seen).all() and seen.min() > 0):
        raise InputError(f"the neutral is {neutral!r}, expected three positive readings")
    if camera_to_xyz is None:
        # Adapted to the neutral; otherwise a converter would take the light of the shot for coloured.
        camera_to_xyz = np.array(SRGB_TO_XYZ) if seen is None else np.array(SRGB_TO_XYZ) / seen * seen.max()
    matrix = np.asarray(camera_to_xyz, np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < 3:
        raise InputError(f"camera_to_xyz is {camera_to_xyz!r}, expected a 3 x 3 matrix with an inverse")
    to_camera = np.linalg.inv(matrix)
    if seen is None:
        seen = to_camera @ D50
    if panchromatic is not None:
        weights = np.asarray(panchromatic, np.float64)
        to_camera = np.vstack([to_camera, weights @ to_camera])
        seen = np.append(seen, weights @ seen)
    from_d65 = adaptation(xyz(*D65_XY))
    return {
        Tag.COLOR_MATRIX_1: (FieldType.SRATIONAL, _to_one(to_camera, to_camera @ D50).ravel().tolist()),
        Tag.COLOR_MATRIX_2: (FieldType.SRATIONAL, _to_one(to_camera @ from_d65, to_camera @ D50).ravel().tolist()),
        Tag.CALIBRATION_ILLUMINANT_1: (FieldType.SHORT, [Light.D50]),
        Tag.CALIBRATION_ILLUMINANT_2: (FieldType.SHORT, [Light.D65]),
        # A matrix may make white negative in a channel; AsShotNeutral must not be.
        Tag.AS_SHOT_NEUTRAL: (FieldType.RATIONAL, _to_one(seen, seen).clip(1e-6).tolist()),
    }


def _to_one(values: NDArray[Any], white: NDArray[Any]) -> NDArray[Any]:
    """Scale values so that the largest reading of `white` is 1; DNG leaves the scale open, this is the custom."""
    return np.asarray(values / np.abs(white).max())
