"""Scenes in files of every format."""

import struct
import zlib
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import tifffile
from PIL import Image

LINEAR_RAW, CFA = 34892, 32803
BYTE, ASCII, SHORT, LONG, RATIONAL, SRATIONAL = 1, 2, 3, 4, 5, 10
Fields = dict[int, tuple[int, Any]]
"""Tag -> (TIFF type, values; numerator and denominator in turn where they are rational)."""


def noise(*shape: int, dtype: Any = np.uint16) -> np.ndarray[Any, Any]:
    """Random samples of 12 bits, none of them dark or saturated."""
    return np.random.default_rng(0).integers(200, 4000, shape).astype(dtype)


def save(path: Path, light: Any, channels: str = "RGB") -> Path:
    """Write samples (H, W, C), without loss where the format has none, in the format of the name's
    ending.

    channels: letters of planes that an EXR has by name; a TIFF has planes of grey for other ones
    than RGB.
    """
    match path.suffix:
        case ".npy":
            np.save(path, light)
        case ".exr":
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            planes = dict(zip(channels, np.moveaxis(light, -1, 0).copy(), strict=True))
            with OpenEXR.File(header, planes) as file:
                file.write(str(path))
        case ".tif" if channels == "RGB":
            tifffile.imwrite(path, light, photometric="rgb", compression="deflate", metadata=None)
        case ".tif":
            tifffile.imwrite(path, np.moveaxis(light, -1, 0).copy(), photometric="minisblack")
        case ".png":
            path.write_bytes(imagecodecs.png_encode(light))
        case _:
            Image.fromarray(light).save(path, lossless=True)
    return path


def png(path: Path, samples: Any, **chunks: bytes) -> str:
    """Write a PNG with these chunks before its samples."""
    data = imagecodecs.png_encode(samples)
    for name, content in chunks.items():
        named = name.encode() + content
        chunk = struct.pack(">I", len(content)) + named + struct.pack(">I", zlib.crc32(named))
        data = data[:33] + chunk + data[33:]
    path.write_bytes(data)
    return str(path)


def iccp(profile: bytes) -> bytes:
    """Return the content of the chunk iCCP."""
    return b"profile\0\0" + zlib.compress(profile)


def rationals(values: Any) -> tuple[int, ...]:
    """Numerators and denominators in turn."""
    return tuple(part for value in np.ravel(values) for part in (round(value * 10000), 10000))


def write_dng(
    path: Path,
    samples: Any,
    order: str = "RGGB",
    kind: int = CFA,
    fields: Fields | None = None,
    *,
    above: Fields | None = None,
    **options: Any,
) -> str:
    """A DNG with these samples; order: of its filters; fields: of their directory; options: of
    tifffile.

    above: fields of a first directory, which has a preview; None = that of the samples is the
    first.
    """
    side, filters = round(len(order) ** 0.5), bytes("RGB".index(letter) for letter in order)
    pattern: Fields = {33421: (SHORT, (side, side)), 33422: (BYTE, filters)} if kind == CFA else {}
    first: Fields = {50706: (BYTE, (1, 4, 0, 0)), 50708: (ASCII, "Test camera"), **(above or {})}
    tags = _tags({**(first if above is None else {}), **pattern, **(fields or {})})
    single = kind == LINEAR_RAW and samples.ndim == 2  # tifffile writes none
    with tifffile.TiffWriter(path, byteorder="<") as file:
        if above is not None:
            preview: dict[str, Any] = {"photometric": "rgb", "subfiletype": 1, "subifds": 1}
            preview |= {"extratags": _tags(first), "metadata": None}
            file.write(np.zeros((8, 8, 3), np.uint8), **preview)
        options |= {"photometric": "minisblack" if single else kind, "extratags": tags}
        if samples.ndim == 3:  # tifffile 2026.5 would write many pictures of one sample
            options.setdefault("planarconfig", "contig")
        file.write(samples, metadata=None, **options)
    if single:
        grey, linear = (struct.pack("<HHII", 262, SHORT, 1, number) for number in (1, LINEAR_RAW))
        path.write_bytes(path.read_bytes().replace(grey, linear))
    return str(path)


def replace_segment(path: Path, segment: bytes | bytearray) -> None:
    """Put a strip or tile, behind all others, in the place of the first one of a DNG's samples."""
    end = path.stat().st_size
    with tifffile.TiffFile(path, mode="r+") as file:
        page: Any = file.pages.first
        tags = (page.pages[0] if page.pages else page).tags
        for numbers, value in (((273, 324), end), ((279, 325), len(segment))):
            tag = next(tags[number] for number in numbers if number in tags)
            tag.overwrite((value, *tag.value[1:]))
    path.write_bytes(path.read_bytes() + segment)


def _tags(fields: Fields) -> list[Any]:
    tags = []
    for tag, (kind, values) in fields.items():
        numbers = 2 if kind in (RATIONAL, SRATIONAL) else 1  # of each value
        count = 0 if isinstance(values, str) else len(values) // numbers
        tags.append((tag, kind, count, values if not count else tuple(values), True))
    return tags
