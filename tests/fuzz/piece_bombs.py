"""Small files in needlessly many pieces, or in pieces that are holes: what a reader does that takes them one at a time."""

import struct
import zlib

from tests.fuzz.forged import Entries, chunk, longs, picture, png, tiff

_LINEAR_RAW, _DNG_VERSION = 34892, 50706


def piece_bombs() -> dict[str, tuple[bytes, int]]:
    """File name -> (first bytes, length), as in `bombs`."""
    jpeg = picture("JPEG")
    rows = zlib.compress(bytes(120), 9)
    return {
        "segments.jpg": (jpeg[:2] + b"\xff\xe3\0\2" * 3_000_000 + jpeg[2:], 0),
        "comments.jpg": (jpeg[:2] + b"\xff\xfe\0\2" * 3_000_000 + jpeg[2:], 0),
        "restarts.jpg": (jpeg[:2] + b"\xff\xd0" * 5_000_000 + jpeg[2:], 0),
        "filling.jpg": (jpeg[:2] + b"\xff" * 10_000_000 + jpeg[2:], 0),
        "filled-scan.jpg": (jpeg[:-2] + b"\xff" * 20_000_000 + jpeg[-2:], 0),
        "filled-end.jpg": (jpeg[:-2] + b"\xff" * 20_000_000, 0),
        "chunks.png": (png(chunk(b"zzZz", b"") * 3_000_000), 0),
        "samples.png": (png(chunk(b"IDAT", b"") * 3_000_000), 0),
        "rows.tif": (_strips(65536, rows, 65536), 0),
        "rows.nef": (_strips(65536, rows, 65536, linear=True), 0),
        "overlap.nef": (_strips(60_000, rows + bytes(400_000), 1, linear=True), 0),
        "holes.nef": _hole(9000),
        "grey.tif": (_grey(13_000), 0),
    }


def _fields(width: int, height: int, compression: int, rows: int) -> Entries:
    """Fields of a linear DNG without the places of its strips, nor BitsPerSample, which are three numbers elsewhere."""
    values = {254: 0, 256: width, 257: height, 259: compression, 262: _LINEAR_RAW, 277: 3, 278: rows, 284: 1}
    return longs(values) | {_DNG_VERSION: (1, 4, 0x0401)}


def _strips(count: int, strip: bytes, different: int, *, linear: bool = False) -> bytes:
    """A picture of 20 pixels in a row, each row a strip; `different` of them lie in different places."""
    entries = _fields(20, count, 8, 1)
    if not linear:
        del entries[_DNG_VERSION]
        entries[262] = 4, 1, 2
    start = len(tiff(entries)) + 3 * 12
    entries |= {258: (3, 3, start), 273: (4, count, start + 6), 279: (4, count, start + 6 + 4 * count)}
    data = start + 6 + 8 * count
    places = [data + len(strip) * (number % different) for number in range(count)]
    numbers = struct.pack("<3H", 16, 16, 16) + struct.pack(f"<{2 * count}I", *places, *[len(strip)] * count)
    return tiff(entries) + numbers + strip * different


def _hole(side: int) -> tuple[bytes, int]:
    """A linear DNG whose samples, not compressed, are a hole in the file."""
    entries, length = _fields(side, side, 1, side), side * side * 6
    start = len(tiff(entries)) + 3 * 12
    entries |= {258: (3, 3, start), 273: (4, 1, start + 6), 279: (4, 1, length)}
    return tiff(entries) + struct.pack("<3H", 16, 16, 16), start + 6 + length


def _grey(side: int) -> bytes:
    """A grey TIFF that inflates to 200 times its size, and as a scene to twelve times as much again."""
    values = {256: side, 257: side, 258: 8, 259: 8, 262: 1, 277: 1, 278: side}
    entries = longs(values)
    strip = zlib.compress(bytes(side * side), 9).ljust(side * side // 199, b"\0")
    start = len(tiff(entries)) + 2 * 12
    entries |= {273: (4, 1, start), 279: (4, 1, len(strip))}
    return tiff(entries) + strip
