"""The plainest way to make a picture of a Bayer mosaic."""

import numpy as np

from shared.arrays import FloatArray

from .bayer import check_mosaic, sites

# Bilinear interpolation at the missing sites: green from the four beside it, red and blue from the two or four nearest.
_GREEN = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
_RED_BLUE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


def demosaic_bilinear(mosaic: FloatArray, order: str = "RGGB") -> FloatArray:
    """A picture, float32 (H, W, 3), from a Bayer mosaic (H, W), both in scene units: bilinear, measured samples kept.

    Raises InputError for an unknown order, and when the mosaic has fewer than two rows or columns.
    """
    check_mosaic(mosaic)
    from scipy.ndimage import correlate

    planes = np.zeros((3, *mosaic.shape), np.float32)
    for channel, row, column in sites(order):
        planes[channel, row::2, column::2] = mosaic[row::2, column::2]
    # With zeros at the sites that were not measured, one kernel does all cases of a channel; "mirror" is shared.arrays.BORDER,
    # the only border that keeps the filter's phase.
    kernels = (_RED_BLUE, _GREEN, _RED_BLUE)
    return np.stack([correlate(plane, kernel, mode="mirror") for plane, kernel in zip(planes, kernels, strict=True)], axis=-1)
