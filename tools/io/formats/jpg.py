"""JPEG with full-resolution colour, capture data and colour profile."""

import struct
from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from ....shared import CaptureMetadata, InputError
from ....shared.dng.tags import LONGEST_SIDE, TAG
from ....shared.tiff import Directory, FieldType, encode_tiff
from ..development import Development, picture_directory
from ..display import joined
from .format import Bands, Format

JFIF_ENDS = 20
"""Bytes of a JPEG's signature and its first segment."""
_LONGEST_EXIF = 65533 - len(b"Exif\0\0")  # what fits a segment
_QUALITY = 95  # if none is asked for


class Jpeg(Format):
    """JPEG. The picture is held in 8 bits."""

    name = "jpg"
    aliases: ClassVar[tuple[str, ...]] = ("jpeg",)
    spaces: ClassVar = {"srgb": (8,), "display-p3": (8,)}
    has_quality = True
    in_bands = True
    longest_side = LONGEST_SIDE
    memory_per_pixel = 6.0  # of noise; pictures take three quarters of that

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        quality = check_quality(development.kind.quality)
        codes = joined(bands, development.written_shape[0])
        segments = jpeg_segments(development.directory, codes.shape, development.icc)
        file.write(baseline_jpeg(codes, quality, segments))


def encode_jpeg(codes: NDArray[Any], metadata: CaptureMetadata, quality: int | None) -> bytes:
    """Return a JPEG of uint8 RGB (H, W, 3), sRGB, without a profile.

    Raises InputError for another quality, and if a side exceeds 65500 pixels, or the capture data
    64 KiB.

    Parameters
    ----------
    metadata : CaptureMetadata
        Capture data; its orientation is noted, the picture is not turned.
    quality : int | None
        1 to 100; None = 95.
    """
    segments = jpeg_segments(picture_directory(metadata, srgb=True), codes.shape)
    return baseline_jpeg(codes, check_quality(quality), segments)


def baseline_jpeg(codes: NDArray[Any], quality: int, segments: bytes) -> bytes:
    """Return a JPEG of uint8 RGB (H, W, 3) or grey (H, W) in full resolution.

    segments: inserted behind JFIF's, which is first.
    """
    codes = np.ascontiguousarray(codes)
    data = bytes(imagecodecs.jpeg8_encode(codes, level=quality, subsampling="444"))
    return data[:JFIF_ENDS] + segments + data[JFIF_ENDS:]


def check_quality(quality: int | None) -> int:
    """Return the quality of a JPEG, None for the usual one, as a number.

    Raises InputError unless it is 1 to 100.
    """
    if quality is None:
        return _QUALITY
    if not 1 <= quality <= 100:
        raise InputError(f"the quality is {quality}, expected 1 to 100")
    return quality


def jpeg_segments(directory: Directory, shape: tuple[int, ...], icc: bytes = b"") -> bytes:
    """The segments of a JPEG of (rows, columns, ...) with capture data and profile; for errors see
    `encode_jpeg`.

    directory: capture data; gets the fields that Exif requires in a JPEG.
    """
    height, width = shape[:2]
    directory.fields[TAG["YCbCrPositioning"]] = FieldType.SHORT, [1]
    directory.children[TAG["ExifTag"]].fields |= {
        TAG["ComponentsConfiguration"]: (FieldType.UNDEFINED, b"\1\2\3\0"),  # Y, Cb, Cr
        TAG["PixelXDimension"]: (FieldType.LONG, [width]),
        TAG["PixelYDimension"]: (FieldType.LONG, [height]),
    }
    exif = encode_tiff(directory)
    if max(height, width) > LONGEST_SIDE:
        most = f"a side of a JPEG holds at most {LONGEST_SIDE}"
        raise InputError(f"{width} x {height} pixels: {most}; use png or tif")
    if len(exif) > _LONGEST_EXIF:
        most = f"a JPEG holds at most {_LONGEST_EXIF}"
        raise InputError(f"the capture data fill {len(exif)} bytes, {most}; use png or tif")
    profile = segment(0xE2, b"ICC_PROFILE\0\1\1" + icc) if icc else b""
    return segment(0xE1, b"Exif\0\0" + exif) + profile


def segment(marker: int, data: bytes) -> bytes:
    """A segment of a JPEG, of at most 65533 bytes."""
    return struct.pack(">BBH", 0xFF, marker, len(data) + 2) + data
