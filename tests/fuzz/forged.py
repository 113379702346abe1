"""Parts of files that say what is not so."""

import io
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from PIL import Image

SIDE = 64
"""Pixels, each way, of a picture that claims to be larger, or is in needlessly many pieces."""
LONG = 4
Entries = dict[int, tuple[int, int, int]]
"""Fields of a TIFF: tag -> (type, count, value or offset)."""


def tiff(entries: Entries, data: bytes = b"") -> bytes:
    """A little-endian TIFF of one directory, at byte 8, and what follows it."""
    table = b"".join(struct.pack("<HHII", tag, *entry) for tag, entry in sorted(entries.items()))
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + table + bytes(4) + data


def longs(values: dict[int, int]) -> Entries:
    """Fields of one number each."""
    return {tag: (LONG, 1, value) for tag, value in values.items()}


def entries_of(data: bytes | bytearray) -> dict[int, tuple[int, int, int, int]]:
    """The fields of the first directory of a TIFF: tag -> (type, count, value or offset, place of the entry)."""
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    places = range(first + 2, first + 2 + 12 * count, 12)
    return {tag: (*entry, place) for place in places for tag, *entry in [struct.unpack_from("<HHII", data, place)]}


def chunk(name: bytes, data: bytes) -> bytes:
    """A chunk of a PNG."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(inserted: bytes = b"", *, side: int = SIDE, bits: int = 8, colour: int = 0, samples: bytes | None = None) -> bytes:
    """A PNG of side x side pixels, grey (colour 0) or RGB (2). inserted: chunks between header and samples."""
    header = struct.pack(">IIBBBBB", side, side, bits, colour, 0, 0, 0)
    if samples is None:
        samples = zlib.compress(bytes(side * (1 + side * bits // 8)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + inserted + chunk(b"IDAT", samples) + chunk(b"IEND", b"")


def picture(kind: str, pixels: NDArray[np.uint8] | None = None, **options: object) -> bytes:
    """A black picture as Pillow writes it. pixels: in place of SIDE x SIDE RGB ones."""
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((SIDE, SIDE, 3), np.uint8) if pixels is None else pixels).save(buffer, kind, **options)
    return buffer.getvalue()


def npy(shape: tuple[int, ...], kind: str = "<f4") -> bytes:
    """The header of an array."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": kind, "fortran_order": False, "shape": shape})
    return buffer.getvalue()


def exr(*parts: OpenEXR.Part) -> bytes:
    """An OpenEXR file of these parts."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "a.exr")
        OpenEXR.File(list(parts)).write(path)
        return Path(path).read_bytes()
