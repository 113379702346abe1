"""WebP pictures."""

from functools import partial
from pathlib import Path

from shared.reading import data_bytes

from ..scene import check_size
from .decoded import Decoded, PictureFormat
from .pillow import read_whole, with_pillow

_LARGEST = 64 << 20  # bytes, read whole; the longest side of a WebP is 16383 pixels


def decode_webp(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a WebP; of an animation the first picture."""
    webp = read_whole(path, _LARGEST, "WebP")
    width, height = _webp_size(webp)
    check_size(width, height, 4, data_bytes(path), max_pixels)
    return with_pillow(webp, max_pixels)


def _webp_size(webp: bytes) -> tuple[int, int]:
    """Return the width and height that a WebP declares, before libwebp makes room for them (RFC 9649, 2.5 to 2.7)."""
    kind, word = webp[12:16], partial(int.from_bytes, byteorder="little")
    if kind == b"VP8X":
        return 1 + word(webp[24:27]), 1 + word(webp[27:30])
    if kind == b"VP8L":
        bits = word(webp[21:25])
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return word(webp[26:28]) & 0x3FFF, word(webp[28:30]) & 0x3FFF


FORMAT = PictureFormat("WebP", rb"RIFF....WEBP", (".webp",), decode_webp)
