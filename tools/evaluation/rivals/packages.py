"""Demosaicing by packages that users have: colour-demosaicing and OpenCV, imported when they are called.

Each `demosaic_` function makes a picture, float32 (H, W, 3), of a Bayer mosaic (H, W), both in scene units. It raises InputError
for an unknown order, and for a frame of less than 2 x 2.
"""

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from tools.host.font_folder import temporary_font_folder

from .bayer import check_mosaic
from .integers import Levels


def demosaic_malvar(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """Malvar, He, Cutler 2004 by colour-demosaicing: linear 5 x 5 filters; float32 (H, W, 3)."""
    check_mosaic(mosaic, order)
    temporary_font_folder()
    from colour_demosaicing import demosaicing_CFA_Bayer_Malvar2004

    return np.asarray(demosaicing_CFA_Bayer_Malvar2004(mosaic, order), np.float32)


def demosaic_menon(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """Menon, Andriani, Calvagno 2007 by colour-demosaicing: directional filters, decision, refinement; float32 (H, W, 3)."""
    check_mosaic(mosaic, order)
    temporary_font_folder()
    from colour_demosaicing import demosaicing_CFA_Bayer_Menon2007

    return np.asarray(demosaicing_CFA_Bayer_Menon2007(mosaic, order), np.float32)


def demosaic_opencv(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """OpenCV's edge-aware interpolation of 16-bit codes, with a pedestal so that nothing is clipped; float32 (H, W, 3)."""
    check_mosaic(mosaic, order)
    levels = Levels.around(mosaic)
    return levels.decode(edge_aware(levels.encode(mosaic), order))


def edge_aware(codes: NDArray[np.uint16], order: str) -> NDArray[np.uint16]:
    """OpenCV's edge-aware interpolation itself: 16-bit codes (H, W) to (H, W, 3)."""
    import cv2

    # The old names, which every version has, are those of the second and third pixel of the second row.
    code = getattr(cv2, f"COLOR_Bayer{order[3]}{order[2]}2RGB_EA")
    return np.asarray(cv2.demosaicing(codes, code), np.uint16)
