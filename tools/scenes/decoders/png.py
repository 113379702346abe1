"""PNG pictures."""

from io import BytesIO
from pathlib import Path

from shared.reading import data_bytes

from ..png_chunks import picture_chunks
from ..scene import check_size
from .decoded import Decoded, PictureFormat, without_alpha
from .pillow import described, pillow, with_pillow

_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes: twice its samples; profile, texts and capture data
_HEADER = 26  # signature, then IHDR's length, name, width, height, bit depth and colour type


def decode_png(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a PNG of any kind. 16-bit colour goes through libpng, because Pillow would reduce it to 8 bits."""
    with path.open("rb") as file:
        header = file.read(_HEADER).ljust(_HEADER, b"\0")
    width, height = (int.from_bytes(header[start : start + 4], "big") for start in (16, 20))
    wide = header[24] == 16
    check_size(width, height, 8 if wide else 4, data_bytes(path), max_pixels)
    png = picture_chunks(path, _MOST_PER_PIXEL * width * height + _MOST_BESIDE)
    if not wide:
        return with_pillow(png, max_pixels)
    import imagecodecs

    pixels, notes = without_alpha(imagecodecs.png_decode(png))
    with pillow().open(BytesIO(png)) as image:
        return described(image, pixels, 65535, notes)


FORMAT = PictureFormat("PNG", rb"\x89PNG\r\n\x1a\n", (".png",), decode_png)
