"""Display white of a camera, and the matrix from its scene units to linear RGB.

**White.** A white surface reads k * neutral, for some k. Display white is the brightest such
reading that every channel can still
measure: its largest channel is 1.0 scene unit, the white level. (Raw developers state the inverse:
white-balance multipliers,
scaled so that the smallest is 1.)

**Colour.** `SensorCalibration.camera_to_xyz` maps scene units to XYZ (D50) under the light of the
neutral. A fitted matrix maps the
neutral only nearly to D50 white; a Bradford adaptation corrects the rest, so that k * neutral
becomes grey, R = G = B. Without a
matrix, channels named R, G and B are assumed to have the primaries of sRGB, whatever others there
are, which do not count then;
one of them and its complement (a sensor with red filters alone) show that against the rest; for any
others there is no such guess.
"""

import numpy as np

from .arrays import DoubleArray
from .calibration import SensorCalibration
from .colorimetry import BRADFORD, SRGB_TO_XYZ, adaptation, is_pair, nominal_to_xyz, white_reading
from .errors import InputError

SATURATED = 0.90, 0.99
"""Fractions of what panchromatic samples can measure between which a place turns white: saturated
ones are even, but for noise.
"""


def display_white(
    calibration: SensorCalibration, to_xyz: DoubleArray | None = None
) -> tuple[DoubleArray, DoubleArray]:
    """Return the reading of display white in each channel, (C,), and the matrix from scene units to
    linear RGB, (3, C); float64.

    The largest reading is 1.0; the matrix maps the readings to (1, 1, 1). A missing neutral is
    taken to be the reading that the camera's matrix maps to D50, without a matrix (1, 1, 1).

    Parameters
    ----------
    to_xyz : DoubleArray | None, optional
        Matrix from the RGB to XYZ (D50), (3, 3); None = that of sRGB.

    Raises
    ------
    InputError
        For channels of unknown colours, and when the camera's matrix maps the neutral to no
        possible white.

    Examples
    --------
    >>> from panchroma.shared import SensorCalibration
    >>> from panchroma.shared.display import display_white
    >>> display_white(SensorCalibration(neutral=(0.5, 2.0, 1.0)))[0].tolist()
    [0.25, 1.0, 0.5]
    """
    channels = calibration.channels
    if calibration.camera_to_xyz is not None:
        camera_to_xyz = np.array(calibration.camera_to_xyz)
    elif set("RGB") <= set(channels) or is_pair(channels):
        camera_to_xyz = nominal_to_xyz(channels, calibration.neutral)
    else:
        remedy = "calibrate the camera (panchroma calibrate), or choose"
        how = '`space="camera"`, as tif, exr or npy'
        raise InputError(f"no colour matrix for the channels {channels}: {remedy} {how}")
    neutral = white_reading(camera_to_xyz, calibration.neutral)
    coloured = camera_to_xyz.any(axis=0)
    # channels without a colour do not count
    neutral = np.where(coloured, neutral, neutral[coloured].max())
    white = neutral / neutral.max()
    xyz = camera_to_xyz @ white
    if min(white) <= 0 or min(BRADFORD @ xyz) <= 0:
        mapped = f"camera_to_xyz maps the white reading {_figures(white)} to XYZ {_figures(xyz)}"
        remedy = 'calibrate again, or use `space="camera"`'
        raise InputError(f"calibration: {mapped}, which is no colour of light; {remedy}")
    rgb_to_xyz = np.array(SRGB_TO_XYZ) if to_xyz is None else to_xyz
    return white, np.linalg.solve(rgb_to_xyz, adaptation(xyz) @ camera_to_xyz)


def _figures(values: DoubleArray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"
