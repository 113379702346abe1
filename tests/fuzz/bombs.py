"""Small files that claim to be huge, and huge files that are empty: each must be refused at once, with little memory.

python -m tests.fuzz.bombs
"""

import io
import json
import resource
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import OpenEXR
import tifffile

from shared import read_camera, read_dng
from shared.dng import encode_dng, verify_dng
from shared.errors import InputError
from shared.tiff import Directory, FieldType, encode_tiff
from tests.fuzz.codec_bombs import codec_bombs
from tests.fuzz.forged import LONG, entries_of, exr, longs, npy, png, tiff
from tests.fuzz.piece_bombs import piece_bombs
from tests.shared.dng.examples import mosaic, preview
from tools.calibration.reference import read_reference
from tools.rendering.defect_list import read_defects
from tools.rendering.journal import NAME as JOURNAL
from tools.rendering.journal import Journal
from tools.scenes.load import load_scene

LIMIT_SECONDS = 1.0
LIMIT_BYTES = 300 * 2**20
GIGABYTE = 1 << 30


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
    ".defects": read_defects,
    ".jsonl": _journal,
    ".json": read_camera,
    ".ti3": read_reference,
}


def bombs() -> dict[str, tuple[bytes, int]]:
    """File name -> (first bytes, length). A file longer than its first bytes goes on with a hole; length 0: no hole."""
    shot = encode_dng(mosaic(), preview())
    deflate = zlib.compress(bytes(GIGABYTE // 4), 9)
    return {
        "declared.dng": (_sides(shot, 16000, 16000), 0),
        "holes.dng": (shot, (1 << 32) - 1),
        "offsets.dng": (_many(273, 20_000_000), 90_000_000),
        "subdirectories.dng": (_many(330, 20_000_000), 90_000_000),
        "preview.dng": (_many(279, 20_000_000), 90_000_000),
        "text.dng": (_many(270, GIGABYTE, kind=2), GIGABYTE + 1000),
        "offsets.tif": (_many(273, 20_000_000), 90_000_000),
        "text.tif": (_many(270, GIGABYTE, kind=2), GIGABYTE + 1000),
        "deflate.tif": (_deflated(deflate), 0),
        "chain.tif": (_chain(300_000), 0),
        "header.png": (png(side=60000, colour=2, samples=b""), 0),
        "header16.png": (png(side=60000, bits=16, colour=2, samples=b""), 0),
        "deflate.png": (png(side=16000, colour=2, samples=deflate), 0),
        "deflate16.png": (png(side=9000, bits=16, colour=2, samples=deflate), 0),
        "holes.png": (png(side=10, bits=16, colour=2, samples=b""), 4 * GIGABYTE),
        "frame.jpg": (_jpeg(65500, 65500), 0),
        "chunk.png": (_chunk(8), 4 * GIGABYTE),
        "chunk16.png": (_chunk(16), 100 << 20),
        "window.exr": (_exr(), 0),
        "attribute.exr": (b"\x76\x2f\x31\x01\2\0\0\0comments\0string\0" + struct.pack("<I", (1 << 31) - 1), 4 * GIGABYTE),
        "header.npy": (b"\x93NUMPY\2\0" + struct.pack("<I", (1 << 32) - 100), 4 * GIGABYTE),
        "shape.npy": (npy((20000, 20000, 3)), 0),
        "holes.npy": (npy((40000, 40000, 3)), 20 * GIGABYTE),
        "holes.json": (b"{", 2 * GIGABYTE),
        "deep.json": (b"[" * 4_000_000, 0),
        "digits.json": (b'{"schema": ' + b"9" * 1_000_000 + b"}", 0),
        "blanks.ti3": (b"CTI3\nBEGIN_DATA_FORMAT" + b" " * 4_000_000, 0),
        "holes.ti3": (b"CTI3\n", 2 * GIGABYTE),
        **codec_bombs(),
        **piece_bombs(),
    }


def _sides(shot: bytes, rows: int, columns: int) -> bytes:
    """A shot whose raw directory, the one with 37 rows, claims this size."""
    data = shot
    for tag, own, claimed in ((256, 53, columns), (257, 37, rows), (278, 37, rows)):
        entry = struct.pack("<HHI", tag, 4, 1)
        assert data.count(entry + struct.pack("<I", own)) == 1
        data = data.replace(entry + struct.pack("<I", own), entry + struct.pack("<I", claimed))
    return data


def _many(tag: int, count: int, kind: int = LONG) -> bytes:
    """A TIFF of one pixel in which the field `tag` claims `count` values."""
    return tiff({**longs({256: 1, 257: 1, 258: 8, 259: 1, 262: 1, 273: 8, 277: 1, 279: 1}), tag: (kind, count, 1000)})


def _deflated(strip: bytes) -> bytes:
    """A TIFF of one strip that inflates to much more than its size."""
    fields = {256: 16000, 257: 16000, 258: 8, 259: 8, 262: 1, 277: 1, 278: 16000}
    return encode_tiff(Directory({tag: (FieldType.LONG, [value]) for tag, value in fields.items()}, strips=[strip]))


def _chain(length: int) -> bytes:
    """A TIFF of `length` pages, each an empty directory."""
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, np.zeros((4, 4), np.uint8))
    data = bytearray(buffer.getvalue())
    end = max(place for *_, place in entries_of(data).values()) + 12  # where the offset of the next page is
    data += bytes(len(data) % 2)
    struct.pack_into("<I", data, end, len(data))
    start = len(data)
    return bytes(data) + b"".join(struct.pack("<HI", 0, start + 6 * (page + 1)) for page in range(length)) + bytes(6)


def _chunk(bits: int) -> bytes:
    """The beginning of a PNG with a chunk of two gigabytes behind the header."""
    return png(side=10, bits=bits, colour=2, samples=b"")[: 8 + 25] + struct.pack(">I", (1 << 31) - 1) + b"zzZz"


def _jpeg(rows: int, columns: int) -> bytes:
    return b"\xff\xd8\xff\xc0" + struct.pack(">HBHHB", 17, 8, rows, columns, 3) + b"\1\x22\0\2\x11\0\3\x11\0\xff\xd9"


def _exr() -> bytes:
    """A picture of 8 x 8 pixels that claims 30000 x 30000."""
    data = exr(OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"RGB": np.zeros((8, 8, 3), np.float32)}, "a"))
    own, claimed = struct.pack("<4i", 0, 0, 7, 7), struct.pack("<4i", 0, 0, 29999, 29999)
    assert data.count(own) == 2
    return data.replace(own, claimed)


_bombs = lru_cache(bombs)


def write(name: str, folder: Path) -> Path:
    """Write the bomb to the folder. Returns its path."""
    start, length = _bombs()[name]
    path = folder / name
    with path.open("wb") as file:
        file.write(start)
        if length:
            file.truncate(length)
    return path


def measure(path: Path) -> tuple[str, float, int]:
    """(refusal, seconds, bytes) of reading a bomb. refusal: "" if it was read; bytes: beyond the process's own memory."""
    load_scene("builtin:24x18")  # loads the libraries, whose memory is not the bomb's
    before, began = _peak(), time.perf_counter()
    try:
        READERS[path.suffix](path)
        said = ""
    except (InputError, OSError) as error:  # OSError: of a journal
        said = str(error).replace(f"{path}: ", "")
    return said, time.perf_counter() - began, _peak() - before


def _peak() -> int:
    """Peak memory of this process, and of the largest of those that it has started."""
    return sum(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) * 1024


def main() -> int:
    if len(sys.argv) > 1:
        print(json.dumps(measure(Path(sys.argv[1]))))
        return 0
    bad = 0
    print(f"{'':24}{'s':>6}{'MB':>6}")
    with tempfile.TemporaryDirectory() as folder:
        for name in _bombs():
            path = write(name, Path(folder))
            line = [sys.executable, "-m", "tests.fuzz.bombs", str(path)]
            done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=100)
            path.unlink(missing_ok=True)
            said, seconds, grown = json.loads(done.stdout) if not done.returncode else (done.stderr[-200:], 99.0, 0)
            # Reading what lies between the holes is harmless if it is quick.
            harmful = seconds > LIMIT_SECONDS or grown > LIMIT_BYTES
            bad += harmful
            print(f"{name:24}{seconds:6.2f}{grown >> 20:6}  {'FAULT ' * harmful}{said[:90] or 'read'}")
    print(f"{len(_bombs())} bombs, {bad} took more than {LIMIT_SECONDS:g} s or {LIMIT_BYTES >> 20} MB")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
