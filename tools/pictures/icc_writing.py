"""Writing of ICC profiles, for the colour spaces of pictures."""

import math
import struct
from functools import cache

from shared.arrays import DoubleArray
from shared.colorimetry import D50, D65_XY, SRGB_ENCODED_KNEE, SRGB_OFFSET, SRGB_POWER, SRGB_SLOPE, adaptation, xyz
from shared.display import SPACES


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
