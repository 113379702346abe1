"""The samples of a sensor in a file of any kind, one number per pixel, whatever its filters are."""

from pathlib import Path

import numpy as np

from shared import read_dng
from shared.arrays import CodeArray
from shared.errors import ForeignFileError, InputError
from shared.reading import MAX_PIXELS

from .camera_raw import camera_raw_samples
from .decoders import guarded
from .load import file_kind, text_name
from .scene import RGB


def sensor_samples(path: Path, max_pixels: int = MAX_PIXELS) -> CodeArray:
    """Read the samples in a shot of Panchroma, in another camera's RAW or DNG, or in a grey TIFF, PNG or NPY: uint16 (H, W).

    path: the file.
    max_pixels: larger files are refused.
    Raises InputError, which does not name the file, for any other file.
    """
    with text_name(path) as name:
        try:
            found, _ = file_kind(name)
        except ForeignFileError:
            return read_dng(name, max_pixels=max_pixels).codes
        if found is None:
            return camera_raw_samples(name, max_pixels)
        with guarded(name):
            pixels = found.decode(name, max_pixels, RGB).pixels
    if pixels.shape[2] != 1:
        raise InputError("is a picture with several colours at each pixel; give the samples of the sensor, one at each pixel")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"its samples are {pixels.dtype}; those of a sensor are whole numbers of 8 or 16 bits")
    return pixels[..., 0].astype(np.uint16)
