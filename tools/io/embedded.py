"""What goes into picture files beside the samples: capture data as TIFF and Exif directories, and ICC profiles."""

import math
import struct
from functools import cache

from shared import CaptureMetadata
from shared.arrays import DoubleArray
from shared.colorimetry import D50, D65_XY, adaptation, xyz
from shared.dng import metadata_directory
from shared.dng.exif import resolution_fields
from shared.dng.tags import MAKER, TAG
from shared.tiff import Directory, FieldType
from tools.io.colour import SRGB_ENCODED_KNEE, SRGB_OFFSET, SRGB_POWER, SRGB_SLOPE
from tools.io.versions import package_version

from .display import SPACES

# Exif 2.3, tables 4 and 15: required fields besides the capture data.
_COLOR_SPACE, _COMPONENTS, _FLASHPIX, _PIXEL_X, _PIXEL_Y = 40961, 37121, 40960, 40962, 40963
_SRGB, _UNCALIBRATED = 1, 65535


def picture_directory(metadata: CaptureMetadata, *, srgb: bool) -> Directory:
    """Return the TIFF directory, with its Exif directory, of a picture in sRGB or in another space."""
    directory = metadata_directory(metadata)
    directory.fields.update(resolution_fields())
    directory.fields[TAG["Software"]] = FieldType.ASCII, software()
    directory.children[TAG["ExifTag"]].fields |= {
        _COLOR_SPACE: (FieldType.SHORT, [_SRGB if srgb else _UNCALIBRATED]),
        _FLASHPIX: (FieldType.UNDEFINED, b"0100"),
    }
    return directory


def jpeg_directory(metadata: CaptureMetadata, shape: tuple[int, ...], *, srgb: bool) -> Directory:
    """Return `picture_directory` with the fields that Exif requires in a JPEG; shape: (rows, columns, ...) of the picture."""
    directory = picture_directory(metadata, srgb=srgb)
    directory.fields[TAG["YCbCrPositioning"]] = FieldType.SHORT, [1]
    directory.children[TAG["ExifTag"]].fields |= {
        _COMPONENTS: (FieldType.UNDEFINED, b"\1\2\3\0"),  # Y, Cb, Cr
        _PIXEL_X: (FieldType.LONG, [shape[1]]),
        _PIXEL_Y: (FieldType.LONG, [shape[0]]),
    }
    return directory


def software() -> str:
    """Return name and version of the program; a checkout that is not installed has no version."""
    return " ".join(filter(None, (MAKER, package_version("panchroma"))))


@cache
def icc_profile(name: str) -> bytes:
    """Return a matrix/TRC display profile of a space in `SPACES` (ICC.1:2010, version 4.3); always the same bytes."""
    space, scale = SPACES[name], 1 + SRGB_OFFSET
    srgb = [SRGB_POWER, 1 / scale, SRGB_OFFSET / scale, 1 / SRGB_SLOPE, SRGB_ENCODED_KNEE]
    curve = (0, [1.0]) if space.linear else (3, srgb)  # 10.16, table 65
    tags = {
        b"desc": _icc_text(space.title),
        b"cprt": _icc_text("Public domain"),
        b"wtpt": b"XYZ \0\0\0\0" + _fixed(D50),
        b"chad": b"sf32\0\0\0\0" + _fixed(adaptation(xyz(*D65_XY)).ravel()),
        **{b"%cXYZ" % letter: b"XYZ \0\0\0\0" + _fixed(column) for letter, column in zip(b"rgb", space.to_xyz.T, strict=True)},
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), b"para\0\0\0\0" + struct.pack(">H2x", curve[0]) + _fixed(curve[1])),
    }
    table, data = struct.pack(">I", len(tags)), b""
    placed: dict[bytes, int] = {}
    for signature, element in tags.items():
        if element not in placed:  # the three curves share one element
            placed[element] = 128 + 4 + 12 * len(tags) + len(data)
            data += element + bytes(-len(element) % 4)
        table += struct.pack(">4sII", signature, placed[element], len(element))
    header = struct.pack(
        ">I4xI4s4s4s6H4s24xI12s48x",
        *(128 + len(table) + len(data), 0x04300000, b"mntr", b"RGB ", b"XYZ "),
        *(2024, 1, 1, 0, 0, 0),  # a date is required; a fixed one keeps the bytes the same
        *(b"acsp", 1, _fixed(D50)),  # 1: media-relative colorimetric
    )
    return header + table + data


def _fixed(values: DoubleArray | list[float]) -> bytes:
    """Encode numbers as s15Fixed16Number, ICC.1:2010 4.6."""
    return struct.pack(f">{len(values)}i", *(math.floor(value * 65536 + 0.5) for value in values))


def _icc_text(text: str) -> bytes:
    """Encode a text as one record of multiLocalizedUnicodeType, ICC.1:2010 10.13."""
    data = text.encode("utf-16-be")
    return b"mluc\0\0\0\0" + struct.pack(">II4sII", 1, 12, b"enUS", len(data), 28) + data
