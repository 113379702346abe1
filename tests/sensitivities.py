"""Cameras with measured spectral sensitivities, and what they read of a ColorChecker under any light.

All from colour-science (BSD-3-Clause): sensitivities of a Nikon D5100 and a Sigma SD Merrill (M. M. Darrodi et al., "Reference data
set for camera spectral sensitivity estimation", JOSA A 32, 2015), reflectances by N. Ohta (1997), illuminants of the CIE.
"""

import warnings
from typing import Any

import numpy as np
import pytest

from shared.arrays import DoubleArray

CAMERAS = "Nikon 5100 (NPL)", "Sigma SDMerill (NPL)"


def colour_science() -> Any:
    """The package, which warns of packages that it could use; skips the test without it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("colour", reason="colour-science is not installed: pip install 'panchroma[evaluation]'")


def readings(camera: str, light: str) -> DoubleArray:
    """What the camera reads of the patches in reading order, (24, 3), white at 1 at most.

    light: A, D65, or the temperature of a black body in kelvin.
    """
    colour = colour_science()
    shape = colour.SpectralShape(400, 700, 10)

    def sampled(spectra: Any) -> DoubleArray:
        return np.asarray(spectra.copy().align(shape).values, np.float64)

    power = sampled(colour.sd_blackbody(float(light), shape) if light.isdigit() else colour.SDS_ILLUMINANTS[light])
    seen = sampled(colour.MSDS_CAMERA_SENSITIVITIES[camera]).clip(0) * power[:, None]
    patches = np.stack([sampled(each) for each in colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()])
    return patches @ seen / seen.sum(axis=0).max()
