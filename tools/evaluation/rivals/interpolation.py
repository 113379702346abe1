"""Interpolation of a Bayer mosaic: bilinear, and by the package colour-demosaicing, which is imported when it is called.

Each function makes a picture, float32 (H, W, 3), of a Bayer mosaic (H, W), both in scene units.
"""

from functools import partial

import numpy as np

from shared.arrays import FloatArray
from tools.simulation.bayer import channel_map

from ..method import Method

# At missing sites: green is the mean of its four neighbours, red and blue of the nearest two or four.
_GREEN = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
_RED_BLUE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


def demosaic_bilinear(mosaic: FloatArray) -> FloatArray:
    """Bilinear interpolation. Measured samples are kept."""
    from scipy.ndimage import correlate

    colour = channel_map(mosaic.shape)
    planes = (np.where(colour == channel, mosaic, 0).astype(np.float32) for channel in range(3))
    # With zeros at the missing sites one kernel serves all cases of a channel. "mirror" is shared.arrays.BORDER, the only border
    # that keeps the phase of the filters.
    kernels = (_RED_BLUE, _GREEN, _RED_BLUE)
    return np.stack([correlate(plane, kernel, mode="mirror") for plane, kernel in zip(planes, kernels, strict=True)], axis=-1)


def _by_colour_demosaicing(name: str, mosaic: FloatArray) -> FloatArray:
    import colour_demosaicing

    return np.asarray(getattr(colour_demosaicing, name)(mosaic), np.float32)


demosaic_malvar = partial(_by_colour_demosaicing, "demosaicing_CFA_Bayer_Malvar2004")
"""Malvar, He, Cutler 2004: linear 5 x 5 filters."""
demosaic_menon = partial(_by_colour_demosaicing, "demosaicing_CFA_Bayer_Menon2007")
"""Menon, Andriani, Calvagno 2007: directional filters, decision, refinement."""


_PACKAGES = ("colour-demosaicing",)
MENON = Method("menon", "Bayer, Menon 2007", demosaic_menon, packages=_PACKAGES, seconds=0.3)
METHODS = (
    Method("bilinear", "Bayer, bilinear", demosaic_bilinear, seconds=0.05),
    Method("malvar", "Bayer, Malvar 2004", demosaic_malvar, packages=_PACKAGES, seconds=0.1),
    MENON,
    MENON.with_balance(),
)
