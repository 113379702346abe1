"""Encoders: arrays of samples to picture files, one function per format.

The compression levels were chosen on photographs of 12 megapixels: each takes less than a second on one core, and the next better
level takes several times as long to save a few per cent.
"""

import io
import struct
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import imagecodecs
import numpy as np
from numpy.typing import DTypeLike, NDArray

from shared.arrays import FloatArray
from shared.dng.container import picture_fields
from shared.dng.tags import LONGEST_SIDE, Compression, Tag
from shared.errors import InputError, OutputError
from shared.jpeg_writing import ROWS, encode_strip, join_strips
from shared.tiff import Directory, Fields, FieldType, write_tiff
from tools.host.ahead import ahead

_LONGEST_EXIF = 65533 - len(b"Exif\0\0")  # what fits a JPEG segment
_QUALITIES, _QUALITY = range(1, 101), 95  # that can be asked for, and that of a JPEG if none is
_STRIP_ROWS = 64
_PNG_START = 8 + 25  # signature and IHDR

# TIFF 6.0; 34675 is ICC.1:2010 Annex B.4.
_PREDICTOR, _EXTRA, _SAMPLE_FORMAT, _ICC = 317, 338, 339, 34675
_LZW, _HORIZONTAL, _UNSIGNED, _FLOAT, _BLACK_IS_ZERO, _RGB = 5, 2, 1, 3, 1, 2


def encode_tiff_picture(pixels: NDArray[Any], directory: Directory, *, icc: bytes = b"", rgb: bool = True) -> bytes:
    """Return a TIFF file of samples (H, W, C); parameters and errors are those of `write_tiff_picture`."""
    file = io.BytesIO()
    write_tiff_picture(file, [pixels], pixels.shape, pixels.dtype, directory, icc=icc, rgb=rgb)
    return file.getvalue()


def write_tiff_picture(
    file: BinaryIO,
    bands: Iterable[NDArray[Any]],
    shape: tuple[int, ...],
    dtype: DTypeLike,
    directory: Directory,
    *,
    icc: bytes = b"",
    rgb: bool = True,
    threads: int = 1,
) -> None:
    """Write a TIFF of samples that arrive as bands; each band goes to the file as it comes and does not stay in memory.

    file: empty and seekable.
    bands: (rows, W, C), any number of rows each: uint8 (compressed with LZW), uint16 or float32 (uncompressed: noise
        in the last bits makes LZW larger than that, and TIFF 6.0 has nothing better; Deflate came later).
    shape: (H, W, C) of the whole picture.
    dtype: of the samples.
    directory: fields and child directories to write as well.
    icc: colour profile; b"" = none.
    rgb: whether the channels are red, green, blue.
    threads: number of threads that compress.

    Raises InputError if the file would exceed 4 GiB.
    """
    fields = _tiff_fields(shape, np.dtype(dtype), icc, rgb=rgb)
    rows = regrouped(bands, _STRIP_ROWS)
    strips = ahead(_lzw_strip, rows, threads) if np.dtype(dtype) == np.uint8 else map(_plain_strip, rows)
    write_tiff(file, Directory({**directory.fields, **fields}, (), directory.children), strips)


def regrouped(bands: Iterable[NDArray[Any]], rows: int) -> Iterator[NDArray[Any]]:
    """Yield the rows of `bands` in groups of `rows`; the last group may be smaller."""
    kept: list[NDArray[Any]] = []
    for band in bands:
        kept.append(band)
        while (count := sum(map(len, kept))) >= rows:
            joined = np.concatenate(kept) if len(kept) > 1 else kept[0]
            whole = count // rows * rows
            yield from (joined[top : top + rows] for top in range(0, whole, rows))
            kept = [joined[whole:]]
    if any(map(len, kept)):
        yield np.concatenate(kept)


def _tiff_fields(shape: tuple[int, ...], dtype: np.dtype[Any], icc: bytes, *, rgb: bool) -> Fields:
    channels = shape[2]
    floating, compressed = dtype.kind == "f", dtype == np.uint8
    compression, photometric = _LZW if compressed else Compression.NONE, _RGB if rgb else _BLACK_IS_ZERO
    fields = picture_fields(shape, 8 * dtype.itemsize, compression, photometric) | {
        Tag.ROWS_PER_STRIP: (FieldType.LONG, [_STRIP_ROWS]),
        _SAMPLE_FORMAT: (FieldType.SHORT, [_FLOAT if floating else _UNSIGNED] * channels),
    }
    if compressed:
        fields[_PREDICTOR] = FieldType.SHORT, [_HORIZONTAL]
    if extra := channels - (3 if rgb else 1):
        fields[_EXTRA] = FieldType.SHORT, [0] * extra
    if icc:
        fields[_ICC] = FieldType.UNDEFINED, icc
    return fields


def _plain_strip(rows: NDArray[Any]) -> memoryview:
    return np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")).data.cast("B")


def _lzw_strip(rows: NDArray[Any]) -> bytes:
    differences = imagecodecs.delta_encode(np.ascontiguousarray(rows), axis=-2)
    return bytes(imagecodecs.lzw_encode(differences.tobytes()))


def encode_png(codes: NDArray[Any], *, title: str, icc: bytes, exif: bytes) -> bytes:
    """Return a PNG of uint8 or uint16 RGB (H, W, 3), with a profile named `title` and Exif (PNG, third edition: iCCP, eXIf)."""
    # Run lengths of the Paeth residue: photographs have no repetitions to search for. 3 % larger files in a fifth of the time.
    png = imagecodecs.png_encode(
        np.ascontiguousarray(codes), level=1, strategy=imagecodecs.PNG.STRATEGY.RLE, filter=imagecodecs.PNG.FILTER.PAETH
    )
    profile = title.encode("latin-1") + b"\0\0" + zlib.compress(icc)
    return b"".join((png[:_PNG_START], _chunk(b"iCCP", profile), _chunk(b"eXIf", exif), png[_PNG_START:]))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def check_quality(quality: int | None) -> None:
    """Raise InputError unless this is a quality, 1 to 100, or None for the usual one."""
    if quality is not None and quality not in _QUALITIES:
        raise InputError(f"the quality is {quality}, expected {_QUALITIES[0]} to {_QUALITIES[-1]}")


def encode_jpeg(codes: NDArray[Any], *, icc: bytes, exif: bytes, quality: int | None = None) -> bytes:
    """Return a JPEG of uint8 RGB (H, W, 3); parameters and errors are those of `encode_jpeg_bands`."""
    return encode_jpeg_bands([codes], (codes.shape[0], codes.shape[1]), icc=icc, exif=exif, quality=quality)


def encode_jpeg_bands(
    bands: Iterable[NDArray[Any]],
    shape: tuple[int, int],
    *,
    icc: bytes,
    exif: bytes,
    quality: int | None = None,
    threads: int = 1,
) -> bytes:
    """Return a JPEG of uint8 RGB with full-resolution colour, Exif block and profile (b"" = none: sRGB).

    bands: (rows, W, 3), any number of rows each. shape: (H, W) of the whole picture.
    quality: 1 to 100; None = 95.
    threads: number of threads that compress.

    Raises InputError for another quality, and if a side exceeds 65500 pixels, or the Exif block 64 KiB.
    """
    level, segments = jpeg_level(quality), jpeg_segments(shape, icc, exif)
    strips = list(ahead(lambda rows: encode_strip(rows, level, "444"), regrouped(bands, ROWS), threads))
    return join_strips(strips, segments)


def jpeg_level(quality: int | None) -> int:
    """The quality of a JPEG, None for the usual one, as a number. Raises InputError unless it is 1 to 100."""
    check_quality(quality)
    return _QUALITY if quality is None else quality


def jpeg_segments(shape: tuple[int, int], icc: bytes, exif: bytes) -> bytes:
    """The segments of a JPEG with Exif and profile; parameters and errors are those of `encode_jpeg_bands`."""
    height, width = shape
    if max(height, width) > LONGEST_SIDE:
        raise InputError(f"{width} x {height} pixels: a side of a JPEG holds at most {LONGEST_SIDE}; use png or tif")
    if len(exif) > _LONGEST_EXIF:
        raise InputError(f"the capture data fill {len(exif)} bytes, a JPEG holds at most {_LONGEST_EXIF}; use png or tif")
    return segment(0xE1, b"Exif\0\0" + exif) + (segment(0xE2, b"ICC_PROFILE\0\1\1" + icc) if icc else b"")


def segment(marker: int, data: bytes) -> bytes:
    """A segment of a JPEG, of at most 65533 bytes."""
    return struct.pack(">BBH", 0xFF, marker, len(data) + 2) + data


def encode_exr(pixels: FloatArray, channels: str, bits: int, attributes: Mapping[str, object]) -> bytes:
    """Return an OpenEXR file.

    pixels: float32 (H, W, C).
    channels: a letter per channel.
    bits: 32, or 16 for half floats (clipped to +-65504).
    attributes: further header fields, with OpenEXR's names.

    Raises OutputError if a temporary file cannot be written.
    """
    import OpenEXR

    stored: NDArray[np.floating[Any]] = pixels
    compression = OpenEXR.NO_COMPRESSION
    if bits == 16:
        largest = float(np.finfo(np.float16).max)
        stored = pixels.clip(-largest, largest).astype(np.float16)
        # ZIP saves 40 % of half floats, but only 5 % of floats (their last bits are noise), for which it takes too long.
        compression = OpenEXR.ZIP_COMPRESSION
    header = {"compression": compression, "type": OpenEXR.scanlineimage, **attributes}
    planes = {letter: np.ascontiguousarray(stored[..., index]) for index, letter in enumerate(channels)}
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.exr"  # OpenEXR before 3.5 writes to no stream
            OpenEXR.File(header, planes).write(str(path))
            return path.read_bytes()
    except (OSError, RuntimeError) as error:
        raise OutputError(f"no temporary file for OpenEXR ({error}); set TMPDIR to a folder with free space") from error


def encode_npy(pixels: FloatArray) -> bytes:
    """Return a NumPy file, version 1.0, of the array."""
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(pixels), allow_pickle=False)
    return buffer.getvalue()
