"""Parts of files that say what is not so."""

import io
import struct
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from PIL import Image

from panchroma.shared.tiff import Directory, FieldType, encode_tiff

SIDE = 64
"""Pixels, each way, of a picture that claims to be larger, or is in needlessly many pieces."""
Fields = dict[int, int | list[int] | bytes]
"""Fields of a TIFF: one LONG, SHORTs, or bytes; b"": none."""


def tiff(fields: Fields, strips: Sequence[bytes] = (), different: int = 0) -> bytes:
    """A TIFF of one directory. different: 1: all strips are the same bytes of the file; 0: each has
    its own.
    """
    kinds = {int: FieldType.LONG, list: FieldType.SHORT, bytes: FieldType.BYTE}
    known: Any = {
        tag: (kinds[type(value)], [value] if isinstance(value, int) else value)
        for tag, value in fields.items()
        if value != b""
    }
    if not different:
        return encode_tiff(Directory(known, strips=strips))
    sizes: Any = {279: (FieldType.LONG, [len(strips[0])] * len(strips))}
    start = 0
    for _ in range(2):  # how long the directory is does not depend on where the strips are
        offsets = {273: (FieldType.LONG, [start] * len(strips))}
        data = encode_tiff(Directory(known | sizes | offsets))
        start = len(data)
    return data + strips[0]


def places_of(data: bytes | bytearray) -> dict[int, int]:
    """Where the fields of the first directory of a TIFF are, by their tags. A field has its tag,
    type, count, and value or offset.
    """
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    places = range(first + 2, first + 2 + 12 * count, 12)
    return {struct.unpack_from("<H", data, place)[0]: place for place in places}


def chunk(name: bytes, data: bytes) -> bytes:
    """A chunk of a PNG."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(
    inserted: bytes = b"",
    *,
    side: int = SIDE,
    bits: int = 8,
    colour: int = 0,
    samples: bytes | None = None,
) -> bytes:
    """A PNG of side x side pixels, grey (colour 0) or RGB (2). inserted: chunks between header and
    samples.
    """
    header = struct.pack(">IIBBBBB", side, side, bits, colour, 0, 0, 0)
    if samples is None:
        samples = zlib.compress(bytes(side * (1 + side * bits // 8)))
    chunks = chunk(b"IHDR", header) + inserted + chunk(b"IDAT", samples) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def jpeg(side: int = SIDE, **options: object) -> bytes:
    """A black JPEG of side x side RGB pixels as Pillow writes it."""
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((side, side, 3), np.uint8)).save(buffer, "JPEG", **options)
    return buffer.getvalue()


def npy(shape: tuple[int, ...], kind: str = "<f4") -> bytes:
    """The header of an array."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": kind, "fortran_order": False, "shape": shape}
    )
    return buffer.getvalue()


def exr(*parts: OpenEXR.Part) -> bytes:
    """An OpenEXR file of these parts."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "a.exr")
        OpenEXR.File(list(parts)).write(path)
        return Path(path).read_bytes()
