"""Display RGB as samples of a picture file: integer codes, turned upright."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.arrays import ByteArray, CodeArray, FloatArray, strips
from shared.errors import InputError

Sample = TypeVar("Sample", bound=np.generic)


def quantise(encoded: FloatArray, bits: int) -> ByteArray | CodeArray:
    """Return the nearest of 2**bits codes for finite values of any shape, clipped to 0..1: uint8 (8 bits) or uint16 (16)."""
    top = np.float32((1 << bits) - 1)
    codes = np.empty(encoded.shape, np.uint8 if bits == 8 else np.uint16)
    for rows in strips(len(encoded)):
        scaled = encoded[rows].clip(0.0, 1.0)
        scaled *= top
        codes[rows] = np.rint(scaled, out=scaled)
    return codes


def upright(picture: NDArray[Sample], orientation: int) -> NDArray[Sample]:
    """Return a view of the samples (H, W, ...) turned and mirrored by a TIFF orientation, 1 to 8 (TIFF 6.0, tag 274)."""
    if orientation not in range(1, 9):
        raise InputError(f"orientation is {orientation}, expected 1 to 8")
    if orientation >= 5:  # the stored rows are columns of the scene
        picture = picture.swapaxes(0, 1)
    # Direction of each axis after the swap.
    down = -1 if orientation in (3, 4, 7, 8) else 1
    across = -1 if orientation in (2, 3, 6, 7) else 1
    return picture[::down, ::across]
