"""JPEG pictures."""

from dataclasses import replace
from pathlib import Path

from shared.errors import InputError
from shared.jpeg_check import read_header
from shared.reading import data_bytes

from ..exif_reading import picture_metadata
from ..scene import check_size
from .decoded import Decoded, PictureFormat
from .pillow import with_pillow

_LARGEST = 1 << 30  # bytes, read whole


def decode_jpeg(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a JPEG."""
    if path.stat().st_size > _LARGEST:
        raise InputError(f"is larger than {_LARGEST} bytes, more than any JPEG needs: it is damaged; if not, save it as PNG")
    jpeg = path.read_bytes()
    header = read_header(jpeg)
    check_size(header.columns, header.rows, 4, data_bytes(path), max_pixels)
    header.check(max_pixels)
    # Pillow would parse every Exif directory when it opens the file.
    picture = with_pillow(jpeg.replace(b"Exif\0\0", b"Read\0\0"), max_pixels)
    return replace(picture, metadata=picture_metadata({"exif": header.exif}))


FORMAT = PictureFormat("JPEG", rb"\xff\xd8\xff", (".jpg", ".jpeg", ".jpe", ".jfif"), decode_jpeg)
