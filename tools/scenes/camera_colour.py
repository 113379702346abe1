"""Camera colours: the matrix from camera RGB to CIE XYZ, and the camera's white."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import D65_XY, Matrix, adaptation, as_rows, xyz
from shared.white_balance import shades_of_grey


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


def as_shot_or_estimated(
    as_shot: tuple[float, ...] | None, rgb: FloatArray
) -> tuple[tuple[float, ...] | None, bool, tuple[str, ...]]:
    """Return the neutral of a file that may state none, whether it is estimated from the scene `rgb`, and notes for the user."""
    if as_shot is not None:
        return as_shot, False, ()
    estimate = shades_of_grey(rgb)
    if estimate is None:
        return None, False, ("the file has no white balance, and the scene is too dark or too bright to estimate one",)
    figures = ", ".join(f"{value:.3f}" for value in estimate)
    return estimate, True, (f"the file has no white balance: neutral {figures} is estimated from the scene",)
