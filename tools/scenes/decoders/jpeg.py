"""JPEG pictures."""

import warnings
from io import BytesIO
from pathlib import Path

import numpy as np

from shared.dng import read_metadata
from shared.errors import InputError
from shared.jpeg_check import read_header
from shared.reading import data_bytes, read_whole

from ..scene import check_size
from .decoded import Decoded, PictureFormat, profile_encoding

_LARGEST = 1 << 30  # bytes, read whole


def decode_jpeg(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a JPEG."""
    from PIL import Image

    jpeg = read_whole(path, _LARGEST, "a JPEG")
    header = read_header(jpeg)
    check_size(header.columns, header.rows, 4, data_bytes(path), max_pixels)
    header.check(max_pixels)
    Image.MAX_IMAGE_PIXELS = None  # its own limit
    plain = BytesIO(jpeg.replace(b"Exif\0\0", b"Read\0\0"))  # Pillow would parse every Exif directory when it opens the file
    with warnings.catch_warnings(action="ignore"), Image.open(plain, formats=("JPEG",)) as image:
        check_size(*image.size, 4, len(jpeg), max_pixels)
        if image.mode not in ("L", "RGB"):
            raise InputError(f"the picture is of kind {image.mode} (CMYK, Lab, ...); convert it to RGB or grey")
        pixels = np.atleast_3d(np.asarray(image))
        encoding, notes = profile_encoding(image.info.get("icc_profile"))
    return Decoded(pixels, 255, encoding, read_metadata(BytesIO(header.exif)), notes)


FORMAT = PictureFormat("JPEG", rb"\xff\xd8\xff", (".jpg", ".jpeg", ".jpe", ".jfif"), decode_jpeg)
