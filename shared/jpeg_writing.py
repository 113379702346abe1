"""Baseline JPEGs in strips that are encoded independently, in parallel if the caller likes, and joined (ITU T.81, annex B).

A restart interval begins like a new JPEG: prediction starts again, and the Huffman tables are always the standard ones. So the data
of strips need only a restart marker between them. The pixels are those of a JPEG that was encoded as a whole.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import imagecodecs
import numpy as np

from .arrays import ByteArray

ROWS = 64  # of a strip: a multiple of both heights of a unit, and even the widest JPEG has no more than 65535 units in a strip
_FRAME, _SCAN, _INTERVAL, _RESTART, _END = 0xC0, 0xDA, 0xDD, 0xD0, b"\xff\xd9"

Subsampling = Literal["444", "420"]


@dataclass(frozen=True)
class JpegStrip:
    """A strip as a JPEG of its own: (rows, columns), the side of a unit in pixels, and the bytes."""

    shape: tuple[int, int]
    unit: int
    data: bytes


def encode_strip(codes: ByteArray, quality: int, subsampling: Subsampling) -> JpegStrip:
    """Encode at most `ROWS` rows, uint8 RGB (rows, W, 3) or grey (rows, W).

    quality: 1 to 100. subsampling: 420 halves the resolution of colour.
    """
    data = imagecodecs.jpeg8_encode(np.ascontiguousarray(codes), level=quality, subsampling=subsampling)
    return JpegStrip((codes.shape[0], codes.shape[1]), 16 if subsampling == "420" else 8, bytes(data))


def join_strips(strips: Sequence[JpegStrip], segments: bytes = b"") -> bytes:
    """The JPEG of a picture from its strips, from top to bottom; all but the last have `ROWS` rows.

    segments: inserted behind JFIF's, which must be first.
    """
    first, rows = strips[0], sum(strip.shape[0] for strip in strips)
    places = _segments(first.data)
    behind, frame, scan = 4 + int.from_bytes(first.data[4:6], "big"), places[_FRAME], places[_SCAN]
    size = struct.pack(">H", rows)
    head = first.data[:behind] + segments + first.data[behind : frame + 5] + size + first.data[frame + 7 : scan]
    if len(strips) == 1:
        return head + first.data[scan:]
    units = -(-first.shape[1] // first.unit) * (ROWS // first.unit)
    parts = [head, struct.pack(">BBHH", 0xFF, _INTERVAL, 4, units), first.data[scan : _scan_data(first.data, scan)]]
    for number, strip in enumerate(strips):
        data = strip.data
        parts.append(data[_scan_data(data, _segments(data)[_SCAN]) : -len(_END)])
        parts.append(bytes((0xFF, _RESTART + number % 8)) if number + 1 < len(strips) else _END)
    return b"".join(parts)


def _scan_data(jpeg: bytes, scan: int) -> int:
    return scan + 2 + int.from_bytes(jpeg[scan + 2 : scan + 4], "big")


def _segments(jpeg: bytes) -> dict[int, int]:
    """Where the segments of a JPEG of ours begin, by marker, up to its scan."""
    place, found = 2, {}
    while _SCAN not in found:
        found[jpeg[place + 1]] = place
        place += 2 + int.from_bytes(jpeg[place + 2 : place + 4], "big")
    return found
