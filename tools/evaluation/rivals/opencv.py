"""Demosaicing by OpenCV, which is imported when it is called."""

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from tools.camera.bayer import check_mosaic
from tools.host.versions import package_version

from ..method import Method
from .integers import Levels

# Distributions that all install the module cv2.
_DISTRIBUTIONS = ("opencv-contrib-python-headless", "opencv-python-headless", "opencv-contrib-python", "opencv-python")


def demosaic_opencv(mosaic: FloatArray) -> FloatArray:
    """Picture, float32 (H, W, 3), by edge-aware interpolation of a Bayer mosaic (H, W), both in scene units.

    OpenCV gets 16-bit codes with a pedestal, so that nothing is clipped. Raises InputError for a frame of less than 2 x 2.
    """
    check_mosaic(mosaic)
    levels = Levels.around(mosaic)
    return levels.decode(edge_aware(levels.encode(mosaic)))


def edge_aware(codes: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """OpenCV's edge-aware interpolation itself: 16-bit codes (H, W) to (H, W, 3)."""
    import cv2

    # The old name of RGGB, which every version has: that of the second and third pixel of the second row.
    return np.asarray(cv2.demosaicing(codes, cv2.COLOR_BayerBG2RGB_EA), np.uint16)


_INSTALLED = next((name for name in _DISTRIBUTIONS if package_version(name)), _DISTRIBUTIONS[0])
METHODS = (Method("ea", "Bayer, OpenCV edge-aware", demosaic_opencv, packages=(_INSTALLED,), seconds=0.05),)
