"""TIFF 6.0.

8 bits are compressed with LZW, the others are not: noise in the last bits makes LZW larger than
that, and TIFF 6.0 has nothing better; Deflate came later.
"""

from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from ....shared.dng.container import picture_fields
from ....shared.dng.tags import TAG, Compression
from ....shared.tiff import FieldType, write_tiff
from ..ahead import ahead
from ..development import CAMERA, Development
from ..display import regrouped
from .format import Bands, Format

_STRIP_ROWS = 64

_LZW, _HORIZONTAL, _UNSIGNED, _FLOAT, _BLACK_IS_ZERO, _RGB = 5, 2, 1, 3, 1, 2


class Tiff(Format):
    """TIFF; each band goes to the file as it comes.

    Raises InputError for files that would exceed 4 GiB.
    """

    name, aliases = "tif", ("tiff",)
    spaces: ClassVar = {"srgb": (16, 8), "display-p3": (16, 8), "linear-srgb": (32,), CAMERA: (32,)}
    # the bands that wait take less than the planes of the frame that are no longer needed then
    in_bands = True

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        bits, channels = development.kind.bits, len(development.channels)
        rgb, shape = development.channels == "RGB", (*development.written_shape, channels)
        compression = _LZW if bits == 8 else Compression.NONE
        directory = development.directory
        colours = _RGB if rgb else _BLACK_IS_ZERO
        directory.fields |= picture_fields(shape, bits, compression, colours)
        sample = _FLOAT if bits == 32 else _UNSIGNED
        directory.fields[TAG["SampleFormat"]] = FieldType.SHORT, [sample] * channels
        directory.fields[TAG["RowsPerStrip"]] = FieldType.LONG, [_STRIP_ROWS]
        if bits == 8:
            directory.fields[TAG["Predictor"]] = FieldType.SHORT, [_HORIZONTAL]
        if extra := channels - (3 if rgb else 1):
            directory.fields[TAG["ExtraSamples"]] = FieldType.SHORT, [0] * extra
        if development.icc:
            directory.fields[TAG["InterColorProfile"]] = FieldType.UNDEFINED, development.icc
        rows = regrouped(bands, _STRIP_ROWS)
        strips = ahead(_lzw_strip, rows, threads) if bits == 8 else map(_plain_strip, rows)
        write_tiff(file, directory, strips)


def _plain_strip(rows: NDArray[Any]) -> memoryview:
    return np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")).data.cast("B")


def _lzw_strip(rows: NDArray[Any]) -> bytes:
    differences = imagecodecs.delta_encode(np.ascontiguousarray(rows), axis=-2)
    return bytes(imagecodecs.lzw_encode(differences.tobytes()))
