"""Demosaicing by the package colour-demosaicing, which is imported when it is called.

Each function makes a picture, float32 (H, W, 3), of a Bayer mosaic (H, W), both in scene units. It raises InputError for a frame
of less than 2 x 2.
"""

import numpy as np

from shared.arrays import FloatArray
from tools.camera.bayer import check_mosaic
from tools.host.font_folder import temporary_font_folder

from ..method import Method


def demosaic_malvar(mosaic: FloatArray) -> FloatArray:
    """Malvar, He, Cutler 2004 by colour-demosaicing: linear 5 x 5 filters; float32 (H, W, 3)."""
    check_mosaic(mosaic)
    temporary_font_folder()
    from colour_demosaicing import demosaicing_CFA_Bayer_Malvar2004

    return np.asarray(demosaicing_CFA_Bayer_Malvar2004(mosaic), np.float32)


def demosaic_menon(mosaic: FloatArray) -> FloatArray:
    """Menon, Andriani, Calvagno 2007 by colour-demosaicing: directional filters, decision, refinement; float32 (H, W, 3)."""
    check_mosaic(mosaic)
    temporary_font_folder()
    from colour_demosaicing import demosaicing_CFA_Bayer_Menon2007

    return np.asarray(demosaicing_CFA_Bayer_Menon2007(mosaic), np.float32)


_PACKAGES = ("colour-demosaicing",)
MENON = Method("menon", "Bayer, Menon 2007", demosaic_menon, packages=_PACKAGES, seconds=0.3)
METHODS = (
    Method("malvar", "Bayer, Malvar 2004", demosaic_malvar, packages=_PACKAGES, seconds=0.1),
    MENON,
    MENON.with_balance(),
)
