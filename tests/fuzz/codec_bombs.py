"""Small files whose compressed parts declare sizes of their own: what a decoder does that is not told the size first."""

import io
import lzma
import struct
import tempfile
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
from PIL import Image

from shared import CfaPattern
from shared.dng import encode_dng
from shared.tiff import Directory, FieldType, encode_tiff
from tests.shared.dng.examples import mosaic, preview

_SIDE = 64
_HUGE = 65500
_FLAT = np.zeros((_SIDE, _SIDE, 3), np.uint8)
_FRAME = {"jpeg": b"\xff\xc0", "progressive": b"\xff\xc2", "lossless": b"\xff\xc3"}


def codec_bombs() -> dict[str, tuple[bytes, int]]:
    """File name -> (first bytes, length), as in `bombs`."""
    pattern = CfaPattern.bayer(6)
    claimed = {kind: _claim(kind) for kind in _FRAME}
    flat = np.zeros((12000, 12000), np.uint8)
    strips: dict[str, tuple[int, bytes | bytearray]] = {
        "jpeg": (7, claimed["progressive"]),
        "jpeg2000": (34712, imagecodecs.jpeg2k_encode(flat)),
        "lerc": (34887, imagecodecs.lerc_encode(flat)),
        "jpegxl": (50002, imagecodecs.jpegxl_encode(flat, effort=1)),
        "jpegxr": (34934, imagecodecs.jpegxr_encode(flat)),
        "png": (34933, imagecodecs.png_encode(flat)),
        "webp": (50001, imagecodecs.webp_encode(np.zeros((8000, 8000, 3), np.uint8), lossless=True)),
        "lzma": (34925, lzma.compress(bytes(300 << 20), preset=0)),
        "zstd": (50000, imagecodecs.zstd_encode(bytes(300 << 20))),
        "inflate": (8, zlib.compress(bytes(300 << 20), 9)),
        "packbits": (32773, b"\x81\0" * 1_000_000),
    }
    shot = encode_dng(mosaic(pattern), preview())
    return {
        "jpeg-preview.dng": (_swapped(shot, claimed["jpeg"]), 0),
        "progressive-preview.dng": (_swapped(shot, claimed["progressive"]), 0),
        **{f"{name}.tif": (_tiff(*strip), 0) for name, strip in strips.items()},
        "tile.tif": (_tiff(8, zlib.compress(bytes(300 << 20), 9), tile=20000), 0),
        "overlap.tif": (_overlap(), 0),
        "lossless.nef": (_raw(7, claimed["lossless"]), 0),
        "lossy.nef": (_raw(34892, claimed["progressive"], photometric=34892, bits=8, planes=3), 0),
        "texts.png": (_png(*[(b"zTXt", b"a%d\0\0" % number + zlib.compress(bytes(1_000_000), 9)) for number in range(3000)]), 0),
        "texts16.png": (_png(*[(b"zTXt", b"a\0\0" + zlib.compress(bytes(7_000_000), 9))] * 400, bits=16), 0),
        "profile.png": (_png((b"iCCP", b"a\0\0" + zlib.compress(bytes(300 << 20), 9))), 0),
        "flat.png": (_flat_picture("PNG"), 0),
        "flat.webp": (_flat_picture("WEBP", lossless=True), 0),
        "scans.jpg": (_scans(5000), 0),
        "exif.jpg": (_exif_jpeg(), 0),
        "canvas.webp": (b"RIFF" + struct.pack("<I", 100) + b"WEBPVP8X" + struct.pack("<II", 10, 2) + b"\xff\x3f\0\xff\x3f\0", 0),
        "tiles.exr": (_exr_tiles(), 0),
        "parts.exr": (_exr_parts(), 0),
        "holes-inside.npy": (_npy((14000, 14000, 3)), 14000 * 14000 * 24 + 128),
        "digits.defects": (b"[[" + b"9" * 5000 + b", 1]]", 0),
        "long.defects": (b"1 2\n" * 6_000_000, 0),
        "line.jsonl": (b"{", 3 << 30),
    }


def _claim(kind: str) -> bytes:
    """A JPEG of 64 x 64 pixels whose frame claims 65500 x 65500."""
    if kind == "lossless":
        jpeg = bytes(imagecodecs.jpeg8_encode(np.zeros((_SIDE, _SIDE), np.uint16), lossless=True, predictor=1, bitspersample=16))
    else:
        jpeg = _picture("JPEG", progressive=kind == "progressive")
    place = jpeg.index(_FRAME[kind]) + 5
    return jpeg[:place] + struct.pack(">HH", _HUGE, _HUGE) + jpeg[place + 4 :]


def _picture(kind: str, pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]] = _FLAT, **options: object) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind, **options)
    return buffer.getvalue()


def _flat_picture(kind: str, **options: object) -> bytes:
    return _picture(kind, np.zeros((8000, 8000, 3), np.uint8), **options)


def _swapped(shot: bytes, jpeg: bytes) -> bytes:
    """The shot with another preview: appended, and named by the fields of the first directory."""
    data = bytearray(shot)
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    for place in range(first + 2, first + 2 + 12 * count, 12):
        (tag,) = struct.unpack_from("<H", data, place)
        if tag in (273, 279):
            struct.pack_into("<I", data, place + 8, len(data) if tag == 273 else len(jpeg))
    return bytes(data) + jpeg


def _tiff(compression: int, strip: bytes | bytearray, tile: int = 0) -> bytes:
    """A TIFF of 64 x 64 grey pixels with this strip, or tile of such a side."""
    fields = {256: _SIDE, 257: _SIDE, 258: 8, 259: compression, 262: 1, 277: 1, 278: _SIDE}
    whole = encode_tiff(Directory({tag: (FieldType.LONG, [value]) for tag, value in fields.items()}, strips=[bytes(strip)]))
    return _as_tile(whole, tile) if tile else whole


def _as_tile(whole: bytes, side: int) -> bytes:
    """The TIFF with its strip as a tile: RowsPerStrip and the fields of strips become those of tiles."""
    (first,) = struct.unpack_from("<I", whole, 4)
    (count,) = struct.unpack_from("<H", whole, first)
    entries = {}
    for tag, kind, length, value in struct.iter_unpack("<HHII", whole[first + 2 : first + 2 + 12 * count]):
        entries[{273: 324, 279: 325, 278: 322}.get(tag, tag)] = kind, length, side if tag == 278 else value
    entries[323] = 4, 1, side
    table = b"".join(struct.pack("<HHII", tag, *entry) for tag, entry in sorted(entries.items()))
    return whole[:4] + struct.pack("<I", len(whole)) + whole[8:] + struct.pack("<H", len(entries)) + table + bytes(4)


def _overlap() -> bytes:
    """A TIFF of 20,000 strips that all are the same 400 kB."""
    strip, count = zlib.compress(np.random.default_rng(0).bytes(400_000), 1), 20_000
    fields = {256: 20, 257: count, 258: 8, 259: 8, 262: 1, 277: 1, 278: 1}
    start = 8 + 2 + 12 * 9 + 4
    places = {273: (4, count, start), 279: (4, count, start + 4 * count)}
    table = {tag: (4, 1, value) for tag, value in fields.items()} | places
    head = (
        b"II*\0"
        + struct.pack("<IH", 8, len(table))
        + b"".join(struct.pack("<HHII", t, *table[t]) for t in sorted(table))
        + bytes(4)
    )
    return head + struct.pack(f"<{count}I", *[start + 8 * count] * count) + struct.pack(f"<{count}I", *[len(strip)] * count) + strip


def _raw(compression: int, strip: bytes, photometric: int = 32803, bits: int = 16, planes: int = 1) -> bytes:
    """A Bayer camera's DNG of 64 x 64 samples with this strip."""
    fields = {256: _SIDE, 257: _SIDE, 259: compression, 262: photometric, 277: planes, 278: _SIDE, 284: 1, 254: 0}
    directory = Directory({tag: (FieldType.LONG, [value]) for tag, value in fields.items()}, strips=[strip])
    directory.fields |= {258: (FieldType.SHORT, [bits] * planes), 33421: (FieldType.SHORT, [2, 2])}
    directory.fields |= {50706: (FieldType.BYTE, bytes([1, 4, 0, 0])), 33422: (FieldType.BYTE, bytes([0, 1, 1, 2]))}
    directory.fields |= {271: (FieldType.ASCII, "Camera"), 272: (FieldType.ASCII, "Camera")}
    return encode_tiff(directory)


def _png(*chunks: tuple[bytes, bytes], bits: int = 8) -> bytes:
    """A PNG of 64 x 64 grey pixels with these chunks before its samples."""
    header = b"IHDR", struct.pack(">IIBBBBB", _SIDE, _SIDE, bits, 0, 0, 0, 0)
    samples = b"IDAT", zlib.compress(bytes(_SIDE * (1 + _SIDE * bits // 8)))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in (header, *chunks, samples, (b"IEND", b""))
    )


def _scans(count: int) -> bytes:
    """A progressive JPEG of 2000 x 2000 pixels whose last scan is repeated."""
    jpeg = _picture("JPEG", np.zeros((2000, 2000, 3), np.uint8), progressive=True)
    last = jpeg.rindex(b"\xff\xda")
    return jpeg[:-2] + jpeg[last:-2] * count + jpeg[-2:]


def _exif_jpeg() -> bytes:
    """A JPEG whose Exif block has 1,000 fields that all are the same 50 kB."""
    table = b"".join(struct.pack("<HHII", tag, 3, 25_000, 8) for tag in range(1000, 2000))
    block = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1000) + table + bytes(50_000)
    jpeg = _picture("JPEG")
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:]


def _exr(parts: list[OpenEXR.Part]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "a.exr")
        OpenEXR.File(parts).write(path)
        return Path(path).read_bytes()


def _exr_tiles() -> bytes:
    """A picture of 64 x 64 pixels in tiles of 32 x 32 that claim to be 60000 x 60000."""
    description = OpenEXR.TileDescription()
    description.xSize = description.ySize = 32
    header = {"type": OpenEXR.tiledimage, "tiles": description, "compression": OpenEXR.ZIP_COMPRESSION}
    data = _exr([OpenEXR.Part(header, {"RGB": np.zeros((_SIDE, _SIDE, 3), np.float32)}, "a")])
    return data.replace(b"tiledesc\0" + struct.pack("<III", 9, 32, 32), b"tiledesc\0" + struct.pack("<III", 9, 60000, 60000))


def _exr_parts() -> bytes:
    """A small picture whose second part is a large one."""
    pixels = [np.zeros((side, side), np.float32) for side in (_SIDE, 9000)]
    window = np.array([0, 0], np.int32), np.array([8999, 8999], np.int32)  # of display: all parts have the same
    headers = [{"type": OpenEXR.scanlineimage, "displayWindow": window} for _ in pixels]
    return _exr([OpenEXR.Part(header, {"Y": each}, f"p{each.shape[0]}") for header, each in zip(headers, pixels, strict=True)])


def _npy(shape: tuple[int, ...]) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return buffer.getvalue()
