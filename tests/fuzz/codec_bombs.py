"""Small files whose compressed parts declare sizes of their own: what a decoder does that is not told the size first."""

import lzma
import struct
import zlib

import imagecodecs
import numpy as np
import OpenEXR

from shared import CfaPattern
from shared.dng import encode_dng
from shared.tiff import Directory, FieldType, encode_tiff
from tests.fuzz.forged import LONG, SIDE, Entries, chunk, entries_of, exr, longs, npy, picture, png, tiff
from tests.shared.dng.examples import mosaic, preview

_HUGE = 65500
_LARGE = np.zeros((8000, 8000, 3), np.uint8)
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
    shot, text = encode_dng(mosaic(pattern), preview()), zlib.compress(bytes(1_000_000), 9)
    return {
        "jpeg-preview.dng": (_swapped(shot, claimed["jpeg"]), 0),
        "progressive-preview.dng": (_swapped(shot, claimed["progressive"]), 0),
        **{f"{name}.tif": (_tiff(*strip), 0) for name, strip in strips.items()},
        "tile.tif": (_tiff(8, zlib.compress(bytes(300 << 20), 9), tile=20000), 0),
        "overlap.tif": (_overlap(), 0),
        "lossless.nef": (_raw(7, claimed["lossless"]), 0),
        "lossy.nef": (_raw(34892, claimed["progressive"], photometric=34892, bits=8, planes=3), 0),
        "texts.png": (
            png(b"".join(chunk(b"zTXt", b"a%d\0\0" % number + text) for number in range(3000))),
            0,
        ),
        "texts16.png": (png(chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(7_000_000), 9)) * 400, bits=16), 0),
        "profile.png": (png(chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(300 << 20), 9))), 0),
        "flat.png": (picture("PNG", _LARGE), 0),
        "scans.jpg": (_scans(5000), 0),
        "exif.jpg": (_exif_jpeg(), 0),
        "tiles.exr": (_exr_tiles(), 0),
        "parts.exr": (_exr_parts(), 0),
        "holes-inside.npy": (npy((14000, 14000, 3), "<f8"), 14000 * 14000 * 24 + 128),
        "digits.defects": (b"[[" + b"9" * 5000 + b", 1]]", 0),
        "long.defects": (b"1 2\n" * 6_000_000, 0),
        "line.jsonl": (b"{", 3 << 30),
    }


def _claim(kind: str) -> bytes:
    """A JPEG of 64 x 64 pixels whose frame claims 65500 x 65500."""
    if kind == "lossless":
        jpeg = bytes(imagecodecs.jpeg8_encode(np.zeros((SIDE, SIDE), np.uint16), lossless=True, predictor=1, bitspersample=16))
    else:
        jpeg = picture("JPEG", progressive=kind == "progressive")
    place = jpeg.index(_FRAME[kind]) + 5
    return jpeg[:place] + struct.pack(">HH", _HUGE, _HUGE) + jpeg[place + 4 :]


def _swapped(shot: bytes, jpeg: bytes) -> bytes:
    """The shot with another preview: appended, and named by the fields of the first directory."""
    data = bytearray(shot)
    for tag, value in ((273, len(data)), (279, len(jpeg))):
        struct.pack_into("<I", data, entries_of(shot)[tag][-1] + 8, value)
    return bytes(data) + jpeg


def _tiff(compression: int, strip: bytes | bytearray, tile: int = 0) -> bytes:
    """A TIFF of 64 x 64 grey pixels with this strip, or tile of such a side."""
    fields = longs({256: SIDE, 257: SIDE, 258: 8, 259: compression, 262: 1, 277: 1})
    places = {324: 1, 325: len(strip), 322: tile, 323: tile} if tile else {273: 1, 279: len(strip), 278: SIDE}
    start = len(tiff(fields | longs(places)))
    return tiff(fields | longs({**places, 324 if tile else 273: start}), bytes(strip))


def _overlap() -> bytes:
    """A TIFF of 20,000 strips that all are the same 400 kB."""
    strip, count = zlib.compress(np.random.default_rng(0).bytes(400_000), 1), 20_000
    fields = longs({256: 20, 257: count, 258: 8, 259: 8, 262: 1, 277: 1, 278: 1})
    start = len(tiff(fields)) + 2 * 12
    places: Entries = {273: (LONG, count, start), 279: (LONG, count, start + 4 * count)}
    offsets, lengths = [start + 8 * count] * count, [len(strip)] * count
    return tiff(fields | places, struct.pack(f"<{2 * count}I", *offsets, *lengths) + strip)


def _raw(compression: int, strip: bytes, photometric: int = 32803, bits: int = 16, planes: int = 1) -> bytes:
    """A Bayer camera's DNG of 64 x 64 samples with this strip."""
    fields = {256: SIDE, 257: SIDE, 259: compression, 262: photometric, 277: planes, 278: SIDE, 284: 1, 254: 0}
    directory = Directory({tag: (FieldType.LONG, [value]) for tag, value in fields.items()}, strips=[strip])
    directory.fields |= {258: (FieldType.SHORT, [bits] * planes), 33421: (FieldType.SHORT, [2, 2])}
    directory.fields |= {50706: (FieldType.BYTE, bytes([1, 4, 0, 0])), 33422: (FieldType.BYTE, bytes([0, 1, 1, 2]))}
    directory.fields |= {271: (FieldType.ASCII, "Camera"), 272: (FieldType.ASCII, "Camera")}
    return encode_tiff(directory)


def _scans(count: int) -> bytes:
    """A progressive JPEG of 2000 x 2000 pixels whose last scan is repeated."""
    jpeg = picture("JPEG", np.zeros((2000, 2000, 3), np.uint8), progressive=True)
    last = jpeg.rindex(b"\xff\xda")
    return jpeg[:-2] + jpeg[last:-2] * count + jpeg[-2:]


def _exif_jpeg() -> bytes:
    """A JPEG whose Exif block has 1,000 fields that all are the same 50 kB."""
    table = b"".join(struct.pack("<HHII", tag, 3, 25_000, 8) for tag in range(1000, 2000))
    block = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1000) + table + bytes(50_000)
    jpeg = picture("JPEG")
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:]


def _exr_tiles() -> bytes:
    """A picture of 64 x 64 pixels in tiles of 32 x 32 that claim to be 60000 x 60000."""
    description = OpenEXR.TileDescription()
    description.xSize = description.ySize = 32
    header = {"type": OpenEXR.tiledimage, "tiles": description, "compression": OpenEXR.ZIP_COMPRESSION}
    data = exr(OpenEXR.Part(header, {"RGB": np.zeros((SIDE, SIDE, 3), np.float32)}, "a"))
    return data.replace(b"tiledesc\0" + struct.pack("<III", 9, 32, 32), b"tiledesc\0" + struct.pack("<III", 9, 60000, 60000))


def _exr_parts() -> bytes:
    """A small picture whose second part is a large one."""
    pixels = [np.zeros((side, side), np.float32) for side in (SIDE, 9000)]
    window = np.array([0, 0], np.int32), np.array([8999, 8999], np.int32)  # of display: all parts have the same
    headers = [{"type": OpenEXR.scanlineimage, "displayWindow": window} for _ in pixels]
    return exr(*(OpenEXR.Part(header, {"Y": each}, f"p{each.shape[0]}") for header, each in zip(headers, pixels, strict=True)))
