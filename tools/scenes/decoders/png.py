"""PNG pictures. Their samples go through libpng; what is beside them is read here."""

import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from shared.dng import read_metadata
from shared.errors import InputError
from shared.reading import data_bytes

from ..icc_reading import SRGB, Encoding, power_curve
from ..scene import check_size
from .decoded import Decoded, PictureFormat, profile_encoding, without_alpha

_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes: twice its samples; profile and capture data
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# The chunks that make up the picture (PNG, third edition, 11.2 and 11.3), and those beside it, one of each.
_PICTURE, _BESIDE = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"), (b"gAMA", b"sRGB", b"iCCP", b"eXIf")
_LONGEST_BESIDE = 4 << 20  # bytes
_MOST_CHUNKS, _LEAST_CHUNK = 4096, 1024  # more chunks than this have that many bytes on average; encoders write 8 KiB
_FRAME = 12  # length, name and check sum of a chunk
_HEADER = 26  # signature, then IHDR's length, name, width, height, bit depth and colour type


def decode_png(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a PNG of any kind."""
    import imagecodecs

    with path.open("rb") as file:
        header = file.read(_HEADER).ljust(_HEADER, b"\0")
    width, height = (int.from_bytes(header[start : start + 4], "big") for start in (16, 20))
    wide = header[24] == 16
    check_size(width, height, 8 if wide else 4, data_bytes(path), max_pixels)
    png, beside = _chunks(path, _MOST_PER_PIXEL * width * height + _MOST_BESIDE)
    pixels, notes = without_alpha(imagecodecs.png_decode(png))
    encoding, remarks = _encoding(beside)
    metadata = read_metadata(BytesIO(beside.get(b"eXIf", b"")))
    return Decoded(pixels, 65535 if wide else 255, encoding, metadata, notes + remarks)


def _chunks(path: Path, most: int) -> tuple[bytes, dict[bytes, bytes]]:
    """The PNG with its picture alone, and what the chunks beside it hold, by their names. One that is cut short is kept as it is.

    Left out is what decoders expand unasked: texts, animation, unknown chunks.

    path: the file, which begins like a PNG.
    most: bytes that may be kept.
    Raises InputError when the picture is longer, or in more pieces than any encoder makes.
    """
    kept, beside, length, chunks = [_SIGNATURE], dict[bytes, bytes](), 0, 0
    with path.open("rb") as file:
        file.seek(len(_SIGNATURE))
        while len(start := file.read(8)) == 8 and (name := start[4:]).isalpha():
            size = int.from_bytes(start[:4], "big") + _FRAME - len(start)
            chunks += 1
            if chunks > _MOST_CHUNKS + file.tell() // _LEAST_CHUNK:
                raise InputError(f"{chunks} chunks in {file.tell()} bytes: the file is damaged, or made to waste time")
            if name in _PICTURE:
                length += _FRAME + size
                if length > most:
                    raise InputError(f"more than {most} bytes of samples: the file is damaged, or made to fill the memory")
                kept += start, file.read(size)
            elif name in _BESIDE and name not in beside and size <= _LONGEST_BESIDE:
                beside[name] = file.read(size)[:-4]
            else:
                file.seek(size, 1)
            if name == b"IEND":
                break
    return b"".join(kept), beside


def _encoding(beside: dict[bytes, bytes]) -> tuple[Encoding | None, tuple[str, ...]]:
    """The encoding that a PNG declares, and notes: profile before sRGB before gamma (PNG, third edition, 4.3)."""
    compressed = beside.get(b"iCCP", b"").partition(b"\0")[2][1:]  # behind its name and the method, of which there is one
    with suppress(zlib.error):
        if profile := zlib.decompressobj().decompress(compressed, _LONGEST_BESIDE):
            return profile_encoding(profile)
    gamma = int.from_bytes(beside.get(b"gAMA", b""), "big") / 100000
    if b"sRGB" in beside or abs(gamma - 1 / 2.2) < 0.005:  # sRGB files give this gamma for old readers
        return SRGB, ()
    if 0.1 < gamma < 10:
        return Encoding((power_curve(1 / gamma),) * 3, SRGB.to_xyz, f"gamma {gamma:.4g}"), ()
    return None, ()


FORMAT = PictureFormat("PNG", rb"\x89PNG\r\n\x1a\n", (".png",), decode_png)
