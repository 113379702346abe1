"""NumPy arrays."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.errors import InputError

from ..file_size import data_bytes
from ..scene import RGB, check_size
from .decoded import Decoded, PictureFormat, channels_of, without_alpha

_NPY_HEADER = 1 << 16


def decode_npy(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a NumPy array (H, W) or (H, W, C) of unsigned integers or floating point. Pickled objects are refused.

    C is 1 (grey), 3 (RGB), 2 or 4 (with transparency), or the number of `channels`, which are then taken in this order.
    """
    with path.open("rb") as file:
        start = file.read(12)
    # NumPy reads a header of the length that the file declares, in two bytes in version 1, in four in later versions.
    if start[6:7] != b"\1" and int.from_bytes(start[8:12], "little") > _NPY_HEADER:
        raise InputError("the array's header declares an impossible length: the file is damaged, or made to fill the memory")
    stored = np.load(path, mmap_mode="r", allow_pickle=False)
    if stored.ndim in (2, 3):
        check_size(stored.shape[1], stored.shape[0], stored[:1, :1].nbytes, data_bytes(path), max_pixels)
    return decode_array(stored, channels)


def decode_array(array: NDArray[Any], channels: str = RGB) -> Decoded:
    """The picture in an array, of the shapes, types and channels that `decode_npy` reads; a copy."""
    if array.ndim not in (2, 3) or array.dtype.kind not in "uf" or (array.ndim == 3 and not array.shape[2]):
        raise InputError(
            f"the array is {array.dtype} of shape {array.shape}; "
            "expected unsigned integers or floating point, (rows, columns) or (rows, columns, channels)"
        )
    found, notes = channels_of(array.shape[2] if array.ndim == 3 else 1, channels)
    pixels = np.array(array)
    if not found:
        pixels, notes = without_alpha(pixels)
    return Decoded(pixels, np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else None, notes=notes, channels=found or RGB)


FORMAT = PictureFormat("NPY", rb"\x93NUMPY", (".npy",), decode_npy)
