"""PNG pictures."""

from io import BytesIO
from pathlib import Path

from shared.errors import InputError
from shared.reading import data_bytes

from ..scene import check_size
from .decoded import Decoded, PictureFormat, without_alpha
from .pillow import described, pillow, with_pillow

_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes: twice its samples; profile, texts and capture data
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# The chunks that make up the picture (PNG, third edition, 11.2 and 11.3), and those beside it, one of each.
_PICTURE, _BESIDE = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"), (b"gAMA", b"sRGB", b"iCCP", b"eXIf")
_LONGEST_BESIDE = 4 << 20  # bytes
_MOST_CHUNKS, _LEAST_CHUNK = 4096, 1024  # more chunks than this have that many bytes on average; encoders write 8 KiB
_FRAME = 12  # length, name and check sum of a chunk
_HEADER = 26  # signature, then IHDR's length, name, width, height, bit depth and colour type


def decode_png(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a PNG of any kind. 16-bit colour goes through libpng, because Pillow would reduce it to 8 bits."""
    with path.open("rb") as file:
        header = file.read(_HEADER).ljust(_HEADER, b"\0")
    width, height = (int.from_bytes(header[start : start + 4], "big") for start in (16, 20))
    wide = header[24] == 16
    check_size(width, height, 8 if wide else 4, data_bytes(path), max_pixels)
    png = _picture_chunks(path, _MOST_PER_PIXEL * width * height + _MOST_BESIDE)
    if not wide:
        return with_pillow(png, max_pixels)
    import imagecodecs

    pixels, notes = without_alpha(imagecodecs.png_decode(png))
    with pillow().open(BytesIO(png)) as image:
        return described(image, pixels, 65535, notes)


def _picture_chunks(path: Path, most: int) -> bytes:
    """The PNG without what decoders expand unasked: texts, animation, unknown chunks. A chunk that is cut short is kept as it is.

    path: the file, which begins like a PNG.
    most: bytes that may be kept.
    Raises InputError when the picture is longer, or in more pieces than any encoder makes.
    """
    kept, length, seen, chunks = [_SIGNATURE], 0, set(), 0
    with path.open("rb") as file:
        file.seek(len(_SIGNATURE))
        while len(start := file.read(8)) == 8 and (name := start[4:]).isalpha():
            size = int.from_bytes(start[:4], "big") + _FRAME - len(start)
            chunks += 1
            if chunks > _MOST_CHUNKS + file.tell() // _LEAST_CHUNK:
                raise InputError(f"{chunks} chunks in {file.tell()} bytes: the file is damaged, or made to waste time")
            if name in _PICTURE or (name in _BESIDE and name not in seen and size <= _LONGEST_BESIDE):
                seen.add(name)
                length += _FRAME + size
                if length > most:
                    raise InputError(f"more than {most} bytes of samples: the file is damaged, or made to fill the memory")
                kept += start, file.read(size)
            else:
                file.seek(size, 1)
            if name == b"IEND":
                break
    return b"".join(kept)


FORMAT = PictureFormat("PNG", rb"\x89PNG\r\n\x1a\n", (".png",), decode_png)
