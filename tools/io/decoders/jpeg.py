"""JPEG pictures."""

from io import BytesIO
from pathlib import Path

import numpy as np

from shared.dng import read_metadata
from shared.errors import InputError
from shared.jpeg_check import JpegHeader, read_header
from shared.reading import read_whole

from ..file_size import data_bytes
from ..scene import check_size
from .decoded import Decoded, PictureFormat, exif_encoding, profile_encoding, remark_on_unused

_LARGEST = 1 << 30  # bytes, read whole
_PROFILE, _SEVERAL = b"ICC_PROFILE\0", b"MPF\0"  # ICC.1:2022, B.4; CIPA DC-007
_GAIN_MAPS = (b"http://ns.adobe.com/hdr-gain-map/", b"urn:iso:std:iso:ts:21496:-1", b"urn:com:apple:photo:2020:aux:hdrgainmap")


def decode_jpeg(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a JPEG."""
    import imagecodecs

    jpeg = read_whole(path, _LARGEST, "a JPEG")
    header = read_header(jpeg)
    check_size(header.columns, header.rows, 4, data_bytes(path), max_pixels)
    header.check(max_pixels)
    if header.components not in (1, 3) or header.bits != 8:
        kind = f"{header.components} channels of {header.bits} bits"
        raise InputError(f"the JPEG has {kind} (CMYK, ...); convert it to RGB or grey of 8 bits")
    if not header.complete:  # libjpeg makes grey of what is missing
        raise InputError("the picture is cut short: its end is missing; copy it again")
    pixels = np.atleast_3d(imagecodecs.jpeg8_decode(jpeg))
    encoding, notes = profile_encoding(_profile(header))
    if encoding is None:
        encoding, remarks = exif_encoding(BytesIO(header.exif))
        notes += remarks
    notes += remark_on_unused(_unused(jpeg, header))
    return Decoded(pixels, 255, encoding, read_metadata(BytesIO(header.exif)), notes)


def _profile(header: JpegHeader) -> bytes:
    """The ICC profile, whose parts begin with their number and how many there are; b"" without one."""
    return b"".join(part[2:] for part in sorted(header.held(_PROFILE), key=lambda part: part[:1]))


def _unused(jpeg: bytes, header: JpegHeader) -> list[str]:
    if any(mark in jpeg for mark in _GAIN_MAPS):
        return ["a gain map for HDR (this is the plain picture, whose highlights end at white)"]
    return ["further pictures in the file"] if header.held(_SEVERAL) else []


FORMAT = PictureFormat("JPEG", rb"\xff\xd8\xff", (".jpg", ".jpeg", ".jpe", ".jfif"), decode_jpeg)
