"""Small files that claim to be huge, huge ones that are empty, and needlessly many pieces: refused
at once, with little memory.

python -m tests.fuzz.bombs
"""

import lzma
import multiprocessing
import resource
import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
from pebble import ProcessPool

from panchroma.shared import InputError, read_camera, read_dng
from panchroma.shared.dng import encode_dng, verify_dng
from panchroma.tools.batch.journal import NAME as JOURNAL
from panchroma.tools.batch.journal import Journal
from panchroma.tools.calibration.reference import read_reference
from panchroma.tools.simulation.load import load_scene
from tests.benchmarks.harness import memory
from tests.fuzz.forged import SIDE, Fields, chunk, exr, jpeg, npy, places_of, png, tiff
from tests.shared.dng.examples import mosaic, preview

LIMIT_SECONDS = 1.0
LIMIT_BYTES = 300 * 2**20
GIGABYTE = 1 << 30
PIECES = (
    *("segments.jpg", "restarts.jpg", "filled-scan.jpg", "chunks.png"),
    *("samples.png", "rows.tif", "rows.nef", "overlap.nef", "holes.nef", "grey.tif"),
)
"""Bombs in needlessly many pieces, or in pieces that are holes: only time shows that they are
read.
"""
_HUGE = 65500
_LINEAR_RAW, _DNG_VERSION = 34892, {50706: bytes([1, 4, 0, 0])}
_FRAME = {"jpeg": b"\xff\xc0", "progressive": b"\xff\xc2", "lossless": b"\xff\xc3"}


def _scene(path: Path) -> object:
    return load_scene(str(path))


def _shot(path: Path) -> object:
    verify_dng(path)
    return read_dng(path)


def _journal(path: Path) -> object:
    journal = path.rename(path.with_name(JOURNAL))
    try:
        return Journal(path.parent).of("picture.tif")
    finally:
        journal.unlink()


READERS: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys((".tif", ".png", ".jpg", ".exr", ".npy", ".nef"), _scene),
    ".dng": _shot,
    ".jsonl": _journal,
    ".json": read_camera,
    ".ti3": read_reference,
}


@lru_cache
def bombs() -> dict[str, tuple[bytes, int]]:
    """File name -> (first bytes, length). A file longer than its first bytes goes on with a hole;
    length 0: no hole.
    """
    files = _shots() | _tiffs() | _pngs() | _jpegs() | _exrs()
    whole = {name: (data, 0) for name, data in files.items()}
    entries, end = _linear(9000, 9000, 1, 9000), 9000 * 9000 * 6
    hole = tiff(entries | {273: 1, 279: end})
    return whole | {
        "holes.dng": (whole["holes.dng"][0], (1 << 32) - 1),
        "text.dng": (_many(270, GIGABYTE, kind=2), GIGABYTE + 1000),
        "text.tif": (_many(270, GIGABYTE, kind=2), GIGABYTE + 1000),
        **{f"{name}.dng": (_many(tag, 20_000_000), 90_000_000) for name, tag in _FIELDS.items()},
        "offsets.tif": (_many(273, 20_000_000), 90_000_000),
        "holes.nef": (tiff(entries | {273: len(hole), 279: end}), len(hole) + end),
        "holes.png": (png(side=10, bits=16, colour=2, samples=b""), 4 * GIGABYTE),
        "chunk.png": (_chunk(8), 4 * GIGABYTE),
        "hole.png": (_chunk(8, b"IDAT"), 4 * GIGABYTE),
        "attribute.exr": (_COMMENTS + struct.pack("<I", (1 << 31) - 1), 4 * GIGABYTE),
        "header.npy": (b"\x93NUMPY\2\0" + struct.pack("<I", (1 << 32) - 100), 4 * GIGABYTE),
        "holes.npy": (npy((40000, 40000, 3)), 20 * GIGABYTE),
        "holes-inside.npy": (npy((14000, 14000, 3), "<f8"), 14000 * 14000 * 24 + 128),
        "shape.npy": (npy((20000, 20000, 3)), 0),
        "deep.json": (b"[" * 4_000_000, 0),
        "digits.json": (b'{"schema": ' + b"9" * 1_000_000 + b"}", 0),
        "blanks.ti3": (b"CTI3\nBEGIN_DATA_FORMAT" + b" " * 4_000_000, 0),
        "holes.json": (b"{", 2 * GIGABYTE),
        "holes.ti3": (b"CTI3\n", 2 * GIGABYTE),
        "line.jsonl": (b"{", 3 << 30),
    }


_FIELDS = {"offsets": 273, "subdirectories": 330, "preview": 279}
_COMMENTS = b"\x76\x2f\x31\x01\2\0\0\0comments\0string\0"


def _shots() -> dict[str, bytes]:
    """Shots whose directories or previews claim too much."""
    shot = encode_dng(mosaic(), preview())
    huge = shot
    for tag, own in ((256, 53), (257, 37), (278, 37)):  # of the raw directory, the one with 37 rows
        entry = struct.pack("<HHI", tag, 4, 1)
        assert huge.count(entry + struct.pack("<I", own)) == 1
        huge = huge.replace(entry + struct.pack("<I", own), entry + struct.pack("<I", 16000))
    made = {"declared.dng": huge, "holes.dng": shot}
    for kind in ("jpeg", "progressive"):
        data, claim = bytearray(shot), _claim(kind)
        for tag, value in ((273, len(data)), (279, len(claim))):
            struct.pack_into("<I", data, places_of(shot)[tag] + 8, value)
        made[f"{kind}-preview.dng"] = bytes(data) + claim
    return made


def zeros(count: int) -> bytes:
    """The zlib stream of so many zeros, in a thousandth of the space: one megabyte again and again,
    so that it takes no time.
    """
    whole, last = (zlib.compressobj(9, wbits=-15) for _ in range(2))
    megabyte = whole.compress(bytes(1 << 20)) + whole.flush(zlib.Z_FULL_FLUSH)
    end = last.compress(bytes(count % (1 << 20))) + last.flush()
    return b"\x78\xda" + megabyte * (count >> 20) + end + struct.pack(">I", count % 65521 << 16 | 1)


_DEFLATED = zeros(300 << 20)


def _tiffs() -> dict[str, bytes]:
    """Strips of every compression that declare sizes of their own, or lie on each other; camera
    RAWs among them.
    """
    flat = np.zeros((12000, 12000), np.uint8)
    strips: dict[str, tuple[int, bytes | bytearray]] = {
        "jpeg": (7, _claim("progressive")),
        "jpeg2000": (34712, imagecodecs.jpeg2k_encode(flat[:9000, :9000])),
        "jpegxl": (50002, imagecodecs.jpegxl_encode(flat, effort=1)),
        "png": (34933, png(side=len(flat), bits=8, colour=0, samples=zeros(flat.size + len(flat)))),
        "lzma": (34925, lzma.compress(bytes(300 << 20), preset=0)),
        "inflate": (8, _DEFLATED),
        "packbits": (32773, b"\x81\0" * 1_000_000),
    }
    grey: Fields = {256: SIDE, 257: SIDE, 258: 8, 262: 1, 277: 1}
    narrow: Fields = grey | {256: 20, 257: 20_000, 259: 8, 278: 1}
    names: Fields = {33421: [2, 2], 33422: bytes([0, 1, 1, 2]), 271: b"Camera\0", 272: b"Camera\0"}
    square: Fields = {256: SIDE, 257: SIDE, 278: SIDE, 284: 1, 254: 0, **_DNG_VERSION, **names}
    colours: Fields = {258: [8] * 3, 259: _LINEAR_RAW, 262: _LINEAR_RAW, 277: 3}
    rows, raw = _linear(20, 65536, 8, 1), zlib.compress(bytes(120), 9)
    noise = zlib.compress(np.random.default_rng(0).bytes(400_000), 1)
    # grey that inflates to 200 times its size, and as a scene to twelve times as much again
    side = 13_000
    even = zeros(side * side).ljust(side * side // 199, b"\0")
    return {
        **{
            f"{name}.tif": tiff(grey | {259: kind, 278: SIDE}, [bytes(strip)])
            for name, (kind, strip) in strips.items()
        },
        "tile.tif": tiff(grey | {259: 8, 322: 20000, 323: 20000}, [_DEFLATED]),
        "deflate.tif": tiff(grey | {256: 16000, 257: 16000, 259: 8, 278: 16000}, [_DEFLATED]),
        "grey.tif": tiff(grey | {256: side, 257: side, 259: 8, 278: side}, [even]),
        "overlap.tif": tiff(narrow, [noise] * 20_000, different=1),
        "rows.tif": tiff(rows | {50706: b"", 262: 2}, [raw] * 65536),
        "rows.nef": tiff(rows, [raw] * 65536),
        "overlap.nef": tiff(rows | {257: 60_000}, [raw + bytes(400_000)] * 60_000, different=1),
        "lossless.nef": tiff(
            square | {258: [16], 259: 7, 262: 32803, 277: 1}, [_claim("lossless")]
        ),
        "lossy.nef": tiff(square | colours, [_claim("progressive")]),
        "chain.tif": _chain(300_000),
    }


def _linear(width: int, height: int, compression: int, rows: int) -> Fields:
    """Fields of a linear DNG."""
    sizes = {254: 0, 256: width, 257: height, 259: compression, 277: 3, 278: rows, 284: 1}
    return {**sizes, 258: [16] * 3, 262: _LINEAR_RAW, **_DNG_VERSION}


def _pngs() -> dict[str, bytes]:
    text = zlib.compress(bytes(1_000_000), 9)
    texts = b"".join(chunk(b"zTXt", b"a%d\0\0" % number + text) for number in range(3000))
    return {
        "header.png": png(side=60000, colour=2, samples=b""),
        "deflate.png": png(side=16000, colour=2, samples=_DEFLATED),
        "texts.png": png(texts),
        "profile.png": png(chunk(b"iCCP", b"a\0\0" + _DEFLATED)),
        "chunks.png": png(chunk(b"zzZz", b"") * 3_000_000),
        "samples.png": png(chunk(b"IDAT", b"") * 3_000_000),
        "flat.png": png(side=8000, colour=2, samples=zeros(8000 * (3 * 8000 + 1))),
    }


def _jpegs() -> dict[str, bytes]:
    plain, scans = jpeg(), jpeg(2000, progressive=True)
    # 1,000 fields of an Exif block that all are the same 50 kB.
    table = b"".join(struct.pack("<HHII", tag, 3, 25_000, 8) for tag in range(1000, 2000))
    block = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1000) + table + bytes(50_000)
    frame = struct.pack(">HBHHB", 17, 8, _HUGE, _HUGE, 3) + b"\1\x22\0\2\x11\0\3\x11\0"
    return {
        "frame.jpg": b"\xff\xd8\xff\xc0" + frame + b"\xff\xd9",
        "scans.jpg": scans[:-2] + scans[scans.rindex(b"\xff\xda") : -2] * 5000 + scans[-2:],
        "exif.jpg": plain[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + plain[2:],
        "segments.jpg": plain[:2] + b"\xff\xe3\0\2" * 3_000_000 + plain[2:],
        "restarts.jpg": plain[:2] + b"\xff\xd0" * 5_000_000 + plain[2:],
        "filled-scan.jpg": plain[:-2] + b"\xff" * 20_000_000 + plain[-2:],
    }


def _exrs() -> dict[str, bytes]:
    """Pictures with a window, with tiles, and with a second part that are larger than they seem."""
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 32
    # of display: all parts have the same
    window = np.array([0, 0], np.int32), np.array([8999, 8999], np.int32)
    lines = {"type": OpenEXR.scanlineimage}
    tiled = {"type": OpenEXR.tiledimage, "tiles": tiles, "compression": OpenEXR.ZIP_COMPRESSION}
    parts = [
        OpenEXR.Part(
            {**lines, "displayWindow": window}, {"Y": np.zeros((side,) * 2, np.float32)}, f"p{side}"
        )
        for side in (SIDE, 9000)
    ]
    files = {
        "window.exr": exr(OpenEXR.Part(lines, {"RGB": np.zeros((8, 8, 3), np.float32)}, "a")),
        "tiles.exr": exr(OpenEXR.Part(tiled, {"RGB": np.zeros((SIDE, SIDE, 3), np.float32)}, "a")),
        "parts.exr": exr(*parts),
    }
    for name, layout, own, claimed in (
        ("window.exr", "<4i", (0, 0, 7, 7), (0, 0, 29999, 29999)),
        ("tiles.exr", "<9sIII", (b"tiledesc\0", 9, 32, 32), (b"tiledesc\0", 9, 60000, 60000)),
    ):
        assert struct.pack(layout, *own) in files[name]
        files[name] = files[name].replace(struct.pack(layout, *own), struct.pack(layout, *claimed))
    return files


def _many(tag: int, count: int, kind: int = 4) -> bytes:
    """A TIFF of one pixel in which the field `tag` claims `count` values."""
    data = bytearray(tiff({256: 1, 257: 1, 258: 8, 259: 1, 262: 1, 277: 1, 273: 8, 279: 1, tag: 1}))
    struct.pack_into("<HII", data, places_of(data)[tag] + 2, kind, count, 1000)
    return bytes(data)


def _chain(length: int) -> bytes:
    """A TIFF of `length` pages, each an empty directory."""
    data = bytearray(tiff({256: 4, 257: 4, 258: 8, 259: 1, 262: 1, 277: 1, 278: 4}, [bytes(16)]))
    # where the offset of the next page is
    end = max(places_of(data).values()) + 12
    data += bytes(len(data) % 2)
    struct.pack_into("<I", data, end, len(data))
    offsets = range(len(data) + 6, len(data) + 6 * length + 6, 6)
    return bytes(data) + b"".join(struct.pack("<HI", 0, offset) for offset in offsets) + bytes(6)


def _chunk(bits: int, name: bytes = b"zzZz") -> bytes:
    """The beginning of a PNG with a chunk of two gigabytes behind the header."""
    header = png(side=10, bits=bits, colour=2, samples=b"")[: 8 + 25]
    return header + struct.pack(">I", (1 << 31) - 1) + name


def _claim(kind: str) -> bytes:
    """A JPEG of 64 x 64 pixels whose frame claims 65500 x 65500."""
    if kind == "lossless":
        options: Any = {"lossless": True, "predictor": 1, "bitspersample": 16}
        data = bytes(imagecodecs.jpeg8_encode(np.zeros((SIDE, SIDE), np.uint16), **options))
    else:
        data = jpeg(progressive=kind == "progressive")
    place = data.index(_FRAME[kind]) + 5
    return data[:place] + struct.pack(">HH", _HUGE, _HUGE) + data[place + 4 :]


def write(name: str, folder: Path) -> Path:
    """Write the bomb to the folder. Returns its path."""
    start, length = bombs()[name]
    path = folder / name
    with path.open("wb") as file:
        file.write(start)
        if length:
            file.truncate(length)
    return path


def measure(path: Path) -> tuple[str, float, int]:
    """(refusal, seconds, bytes) of reading a bomb. refusal: "" if it was read; bytes: beyond the
    process's own memory.
    """
    load_scene("builtin:24x18")  # loads the libraries, whose memory is not the bomb's
    before, began = _peak(), time.perf_counter()
    try:
        READERS[path.suffix](path)
        refusal = ""
    except (InputError, OSError) as error:  # OSError: of a journal
        refusal = str(error).replace(f"{path}: ", "")
    return refusal, time.perf_counter() - began, _peak() - before


def _peak() -> int:
    """Peak memory of this process, and of the largest of those that it has started."""
    return memory("VmHWM") + 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss


def main() -> int:
    bad, context = 0, multiprocessing.get_context("spawn")
    print(f"{'':24}{'s':>6}{'MB':>6}")
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPool(1, max_tasks=1, context=context) as pool,
    ):
        for name in bombs():
            path = write(name, Path(folder))
            try:
                answer, seconds, grown = pool.schedule(measure, args=[path], timeout=100).result()
            except Exception as error:
                answer, seconds, grown = repr(error), 99.0, 0
            path.unlink(missing_ok=True)
            # Reading what lies between the holes is harmless if it is quick.
            harmful = seconds > LIMIT_SECONDS or grown > LIMIT_BYTES
            bad += harmful
            fault = "FAULT " * harmful
            print(f"{name:24}{seconds:6.2f}{grown >> 20:6}  {fault}{answer[:90] or 'read'}")
    limits = f"{LIMIT_SECONDS:g} s or {LIMIT_BYTES >> 20} MB"
    print(f"{len(bombs())} bombs, {bad} took more than {limits}")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
