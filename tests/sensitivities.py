"""What cameras with measured spectral sensitivities read of a ColorChecker under some lights.

Made by colour-science 0.4.7 (BSD-3-Clause) from its data: sensitivities of a Nikon D5100 and a
Sigma SD Merrill (M. M. Darrodi et al., "Reference data set for camera spectral sensitivity
estimation", JOSA A 32, 2015), reflectances by N. Ohta (1997), illuminants of the CIE, and black
bodies; 400 to 700 nm in steps of 10 nm.
"""

import json
from pathlib import Path

import numpy as np

from panchroma.shared.arrays import DoubleArray

_READINGS = json.loads(Path(__file__).with_suffix(".json").read_text("utf-8"))
CAMERAS = tuple(_READINGS)


def readings(camera: str, light: str) -> DoubleArray:
    """What the camera reads of the patches in reading order, (24, 3), white at 1 at most.

    light: A, D50, D65, or the temperature of a black body in kelvin: 3200, 4000, 5000, 9000.
    """
    return np.array(_READINGS[camera][light])
