"""PNG, with colour profile and Exif (PNG, third edition: iCCP, eXIf)."""

import struct
import zlib
from typing import BinaryIO, ClassVar

import imagecodecs
import numpy as np

from ....shared.tiff import encode_tiff
from ..development import Development
from ..display import SPACES
from .format import Bands, Format

_START = 8 + 25  # signature and IHDR


class Png(Format):
    """PNG."""

    name = "png"
    spaces: ClassVar = {"srgb": (8, 16), "display-p3": (8, 16)}
    memory_per_pixel = 36.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        (codes,), exif = bands, _chunk(b"eXIf", encode_tiff(development.directory))
        # Run lengths of the Paeth residue: photographs have no repetitions to search for. 3 %
        # larger files in a fifth of the time.
        strategy, residue = imagecodecs.PNG.STRATEGY.RLE, imagecodecs.PNG.FILTER.PAETH
        codes = np.ascontiguousarray(codes)
        png = imagecodecs.png_encode(codes, level=1, strategy=strategy, filter=residue)
        title = SPACES[development.kind.space].title.encode("latin-1")
        profile = _chunk(b"iCCP", title + b"\0\0" + zlib.compress(development.icc))
        file.write(b"".join((png[:_START], profile, exif, png[_START:])))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
