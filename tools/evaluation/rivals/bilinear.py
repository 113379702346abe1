"""Bilinear interpolation of a Bayer mosaic."""

from functools import partial

import numpy as np

from ....shared.arrays import FloatArray
from ...simulation.bayer import channel_map
from ..cameras import Method, render_samples

# At missing sites: green is the mean of its four neighbours, red and blue of the nearest two or
# four.
_GREEN = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
_RED_BLUE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


def demosaic_bilinear(mosaic: FloatArray) -> FloatArray:
    """Picture, float32 (H, W, 3), from a Bayer mosaic (H, W), both in scene units. Measured samples
    are kept.
    """
    from scipy.ndimage import correlate

    colour = channel_map(mosaic.shape)
    planes = (np.where(colour == channel, mosaic, 0).astype(np.float32) for channel in range(3))
    # With zeros at the missing sites one kernel serves all cases of a channel. "mirror" is
    # shared.arrays.BORDER, the only border that keeps the phase of the filters.
    pairs = zip(planes, (_RED_BLUE, _GREEN, _RED_BLUE), strict=True)
    return np.stack([correlate(plane, kernel, mode="mirror") for plane, kernel in pairs], axis=-1)


METHODS = (Method("bilinear", "Bayer, bilinear", partial(render_samples, demosaic_bilinear)),)
