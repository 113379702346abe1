"""The colour fields of a DNG: matrices from XYZ to camera RGB, and the reading of white."""

import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calibration import SensorCalibration
from ..colorimetry import D50, D65_XY, SRGB_TO_XYZ, adaptation, xyz
from ..lights import illuminant_xy, to_one
from ..tiff import Fields, FieldType
from .tags import LIGHT_SOURCES, TAG

_MIXTURES = dict(zip("RGBCMY", [*np.eye(3), *(1 - np.eye(3)) / 2], strict=True))
"""Shares of red, green and blue that a nominal filter reads, for all that DNG has codes for."""
_MILLION = 1_000_000  # denominator of chromaticities


def has_colours(channels: str) -> bool:
    """Return True if DNG can state the colours of these channels: three that it knows, none of them
    a mixture of the others.

    With more, or with two, beside the panchromatic plane readers of DNG find no way from camera to
    colours.
    """
    known = [_MIXTURES[letter] for letter in channels if letter in _MIXTURES]
    return len(channels) == len(known) == 3 and bool(np.linalg.matrix_rank(np.array(known)) == 3)


def colour_fields(
    to_xyz: ArrayLike | None, neutral: ArrayLike | None, sensor: SensorCalibration | None = None
) -> Fields:
    """Fields ColorMatrix, CalibrationIlluminant and AsShotNeutral of a camera with three channels.

    With two lights there is a matrix for each. Otherwise both, 1 (D50) and 2 (D65), describe the
    camera under one light. DNG asks for the one under D50, which the calibration has. But LibRaw,
    darktable and similar programs take any matrix for one under D65, and show saturated colours
    wrong by a tenth unless they find such a matrix.

    Parameters
    ----------
    to_xyz : ArrayLike | None
        3 x 3, camera RGB -> XYZ (D50 white); None = a nominal matrix, because DNG requires one:
        sRGB primaries, and of them cyan, magenta and yellow.
    neutral : ArrayLike | None
        Reading of white in the 3 channels; None = the reading that the matrix maps to D50.
    sensor : SensorCalibration | None, optional
        Of a mosaic. Its panchromatic plane comes last and reads the weighted sum of Eq. 7; for its
        channels `has_colours` is true; if it knows two lights, the reader of the file may choose
        one. None = a picture, which all programs show in the same colours.
    """
    white = None if neutral is None else np.asarray(neutral, np.float64)
    channels, panchromatic = (sensor.channels, sensor.gamma) if sensor else ("RGB", None)
    if to_xyz is None:
        # Adapted to the neutral; otherwise a converter would take the light of the shot for
        # coloured.
        nominal = np.array(SRGB_TO_XYZ) @ np.linalg.inv([_MIXTURES[letter] for letter in channels])
        to_xyz = nominal if white is None else nominal / white * white.max()
    to_camera = np.linalg.inv(np.asarray(to_xyz, np.float64))
    white = _planes(to_camera @ D50 if white is None else white, panchromatic)
    to_camera = _planes(to_camera, panchromatic)
    brightest, most = np.abs(to_camera @ D50).max(), np.abs(white).max()  # become 1, as is usual
    from_d65 = to_camera @ adaptation(xyz(*D65_XY))
    matrices = {"D50": to_camera / brightest, "D65": from_d65 / brightest}
    if sensor and sensor.lights:
        colours = {light.illuminant: light.xyz_to_camera for light in sensor.lights}
        matrices = {name: to_one(_planes(colour, panchromatic)) for name, colour in colours.items()}
    # A matrix may make white negative in a channel; AsShotNeutral must not be.
    as_shot = (white / most).clip(1e-6).tolist()
    fields: Fields = {TAG["AsShotNeutral"]: (FieldType.RATIONAL, as_shot)}
    for number, (illuminant, matrix) in enumerate(matrices.items(), 1):
        fields[TAG[f"ColorMatrix{number}"]] = FieldType.SRATIONAL, matrix.ravel().tolist()
        source = LIGHT_SOURCES.get(illuminant, 255)  # 255: as IlluminantData says
        fields[TAG[f"CalibrationIlluminant{number}"]] = FieldType.SHORT, [source]
        if illuminant not in LIGHT_SOURCES:
            x, y = (round(each * _MILLION) for each in illuminant_xy(illuminant))
            data = struct.pack("<H4I", 0, x, _MILLION, y, _MILLION)
            fields[TAG[f"IlluminantData{number}"]] = FieldType.UNDEFINED, data
            # the version of DNG that has IlluminantData
            fields[TAG["DNGVersion"]] = FieldType.BYTE, bytes([1, 6, 0, 0])
    return fields


def _planes(readings: NDArray[Any], panchromatic: ArrayLike | None) -> NDArray[Any]:
    """Readings of three channels, (3, ...), and of the panchromatic plane, if there is one."""
    if panchromatic is None:
        return readings
    return np.concatenate([readings, [np.asarray(panchromatic, np.float64) @ readings]])
