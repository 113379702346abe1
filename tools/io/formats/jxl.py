"""JPEG XL files (ISO/IEC 18181), in the two spaces that the codec labels: sRGB of 8 bits, and
linear light in floating point.
"""

import struct
from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np

from ....shared.tiff import encode_tiff
from ..development import Development
from .format import Bands, Format

LOSSLESS = 100
"""The quality of a JPEG XL without loss."""

# Of floating point, libjxl 0.7 (Ubuntu 24.04, Debian 12) cannot decode what effort 1 and 2 make of
# negative values.
_INTEGER_EFFORT, _FLOAT_EFFORT, _LOSSY_EFFORT = 1, 3, 5
_STREAM = b"jxlc"  # the box with the codestream


class JpegXl(Format):
    """JPEG XL; without a quality nothing is lost."""

    name = "jxl"
    spaces: ClassVar = {"srgb": (8,), "linear-srgb": (32,)}
    about = "JPEG XL, without loss unless it has a quality"
    has_quality = True
    memory_per_pixel = 60.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        (samples,), quality = bands, development.kind.quality
        samples = np.ascontiguousarray(samples)
        if quality in (None, LOSSLESS):
            effort = _FLOAT_EFFORT if samples.dtype.kind == "f" else _INTEGER_EFFORT
            how: dict[str, Any] = {"lossless": True, "effort": effort}
        else:
            how = {"distance": _distance(quality), "effort": _LOSSY_EFFORT}
        picture = imagecodecs.jpegxl_encode(samples, usecontainer=True, **how)
        start, exif = picture.index(_STREAM) - 4, bytes(4) + encode_tiff(development.directory)
        box = struct.pack(">I4s", 8 + len(exif), b"Exif") + exif
        file.write(picture[:start] + box + picture[start:])


def _distance(quality: int) -> float:
    """Distance in just noticeable differences (libjxl, JxlEncoderDistanceFromQuality)."""
    if quality >= 30:
        return 0.1 + 0.09 * (LOSSLESS - quality)
    return 53 / 3000 * quality**2 - 23 / 20 * quality + 25
