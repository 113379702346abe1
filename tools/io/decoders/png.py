"""PNG pictures. Their samples go through libpng; what is beside them is read here."""

import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np

from shared.dng import read_metadata
from shared.errors import InputError

from ..encoding import SRGB, Encoding, coded_encoding, power_curve, space_of
from ..file_size import data_bytes
from ..scene import check_size
from .decoded import Decoded, PictureFormat, profile_encoding, remark_on_unused, without_alpha

_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes: twice its samples; profile and capture data
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# The chunks that make up the picture (PNG, third edition, 11.2 and 11.3), and those beside it, one of each.
_PICTURE, _BESIDE = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"), (b"cICP", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"eXIf")
_UNUSED = {b"mDCV": "the mastering display", b"cLLI": "light levels", b"acTL": "further frames", b"gdAT": "a gain map for HDR"}
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
    png, beside, unused = _chunks(path, _MOST_PER_PIXEL * width * height + _MOST_BESIDE)
    pixels, notes = without_alpha(imagecodecs.png_decode(png))
    encoding, remarks = _encoding(beside, unused, 65535 if wide else 255)
    metadata = read_metadata(BytesIO(beside.get(b"eXIf", b"")))
    return Decoded(pixels, 65535 if wide else 255, encoding, metadata, notes + remarks)


def _chunks(path: Path, most: int) -> tuple[bytes, dict[bytes, bytes], list[str]]:
    """The PNG with its picture alone; what the chunks beside it hold, by their names; and what is left out of the light.

    One that is cut short is kept as it is.

    Left out is what decoders expand unasked: texts, animation, unknown chunks.

    path: the file, which begins like a PNG.
    most: bytes that may be kept.
    Raises InputError when the picture is longer, or in more pieces than any encoder makes.
    """
    kept, beside, unused, length, chunks = [_SIGNATURE], dict[bytes, bytes](), list[str](), 0, 0
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
                # Drafts wrote mDCv and cLLi.
                what = _UNUSED.get(name[:3] + name[3:].upper()) or (name.decode() if name in _BESIDE else "")
                if what and what not in unused:
                    unused.append(what)
            if name == b"IEND":
                break
    return b"".join(kept), beside, unused


def _encoding(beside: dict[bytes, bytes], unused: list[str], peak: int) -> tuple[Encoding | None, tuple[str, ...]]:
    """The encoding that a PNG declares, and notes: cICP before iCCP before sRGB before gAMA and cHRM (PNG, third edition, 4.3).

    unused: what the file has besides; what is declared and not read is added.
    peak: largest sample.
    """
    encoding, notes = None, list[str]()
    if b"cICP" in beside:
        encoding = _coded(beside[b"cICP"], peak)
        if encoding is None:
            unused.append(f"cICP {' '.join(map(str, beside[b'cICP'][:4]))}, an encoding that this program does not read")
    if encoding is None and b"iCCP" in beside:
        profile, compressed = b"", beside[b"iCCP"].partition(b"\0")[2][1:]  # behind its name and the method, of which there is one
        with suppress(zlib.error):
            profile = zlib.decompressobj().decompress(compressed, _LONGEST_BESIDE)
        encoding, remarks = profile_encoding(profile or compressed or b"none")
        notes += remarks
    if encoding is None:
        encoding = SRGB if b"sRGB" in beside else _gamma_and_primaries(beside, unused)
    return encoding, (*notes, *remark_on_unused(unused))


def _coded(code: bytes, peak: int) -> Encoding | None:
    """The encoding that a chunk cICP names: primaries, transfer, matrix, which is 0 for RGB, and whether the range is full."""
    if len(code) != 4 or code[2] or code[3] > 1:
        return None
    return coded_encoding(code[0], code[1], narrow=0 if code[3] else (peak + 1) / 256 / peak)


def _gamma_and_primaries(beside: dict[bytes, bytes], unused: list[str]) -> Encoding | None:
    """The encoding that gAMA and cHRM declare; the curve alone is not declared without gAMA."""
    gamma = int.from_bytes(beside.get(b"gAMA", b""), "big") / 100000
    corners = np.frombuffer(beside.get(b"cHRM", b"").ljust(32, b"\0")[:32], ">u4") / 100000
    to_xyz = space_of([*corners[2:], *corners[:2]])  # white is the first
    usable = 0.1 < gamma < 10
    unused += [name for name, ignored in (("gAMA", not usable), ("cHRM", not to_xyz)) if ignored and name.encode() in beside]
    if not (usable or to_xyz):
        return None
    is_srgb = to_xyz is None or bool(np.allclose(to_xyz, SRGB.to_xyz, atol=0.002))
    if usable and is_srgb and abs(gamma - 1 / 2.2) < 0.005:  # sRGB files give this gamma for old readers
        return SRGB
    curves = (power_curve(1 / gamma),) * 3 if usable else ()
    return Encoding(curves, to_xyz or SRGB.to_xyz, f"gamma {gamma:.4g}" if usable else "primaries alone")


FORMAT = PictureFormat("PNG", rb"\x89PNG\r\n\x1a\n", (".png",), decode_png)
