"""Demosaicing by packages that users have: colour-demosaicing and OpenCV. Each is imported when it is asked for."""

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray

from .bayer import check_mosaic, sites
from .integers import Levels


def demosaic_malvar(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """Malvar, He, Cutler 2004, linear 5 x 5 filters, by colour-demosaicing.

    (H, W) -> float32 (H, W, 3), scene units. Raises InputError for an unknown order or a frame of less than 2 x 2.
    """
    _check(mosaic, order)
    from colour_demosaicing import demosaicing_CFA_Bayer_Malvar2004

    return np.asarray(demosaicing_CFA_Bayer_Malvar2004(mosaic, order), np.float32)


def demosaic_menon(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """Menon, Andriani, Calvagno 2007, directional filtering with a posteriori decision and refinement, by colour-demosaicing.

    (H, W) -> float32 (H, W, 3), scene units. Raises InputError for an unknown order or a frame of less than 2 x 2.
    """
    _check(mosaic, order)
    from colour_demosaicing import demosaicing_CFA_Bayer_Menon2007

    return np.asarray(demosaicing_CFA_Bayer_Menon2007(mosaic, order), np.float32)


def demosaic_opencv(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """OpenCV's edge-aware interpolation, 16 bits, with a pedestal so that nothing is clipped.

    (H, W) -> float32 (H, W, 3), scene units. Raises InputError for an unknown order or a frame of less than 2 x 2.
    """
    _check(mosaic, order)
    levels = Levels.around(mosaic)
    return levels.decode(edge_aware(levels.encode(mosaic), order))


def edge_aware(codes: NDArray[np.uint16], order: str) -> NDArray[np.uint16]:
    """OpenCV's edge-aware interpolation itself: 16-bit codes (H, W) -> (H, W, 3)."""
    import cv2

    # By the old names, which are of the second row's second and third pixel: those every version has.
    code = getattr(cv2, f"COLOR_Bayer{order[3]}{order[2]}2RGB_EA")
    return np.asarray(cv2.demosaicing(codes, code), np.uint16)


def _check(mosaic: FloatArray, order: str) -> None:
    check_mosaic(mosaic)
    sites(order)
