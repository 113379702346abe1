"""Formats whose codec takes a picture at once.

PNG, with colour profile and Exif (PNG, third edition: iCCP, eXIf). JPEG XL (ISO/IEC 18181), in the
two spaces that the codec labels: sRGB of 8 bits, and linear light in floating point. OpenEXR, with
the capture data as standard optional attributes. NumPy's own files: the samples, and nothing else.
"""

import struct
import tempfile
import zlib
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np

from ....shared import CaptureMetadata, OutputError
from ....shared.colorimetry import D65_XY
from ....shared.tiff import encode_tiff
from ..development import CAMERA, Bands, Development, Format, software
from ..display import SPACES

_PNG_START = 8 + 25  # signature and IHDR
LOSSLESS = 100
"""The quality of a JPEG XL without loss."""
# Of floating point, libjxl 0.7 (Ubuntu 24.04, Debian 12) cannot decode what effort 1 and 2 make of
# negative values.
_INTEGER_EFFORT, _FLOAT_EFFORT, _LOSSY_EFFORT = 1, 3, 5
_STREAM = b"jxlc"  # the box with the codestream


class Png(Format):
    """PNG."""

    name = "png"
    spaces: ClassVar = {"srgb": (8, 16), "display-p3": (8, 16)}
    memory_per_pixel = 36.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        (codes,), exif = bands, _chunk(b"eXIf", encode_tiff(development.directory))
        # Run lengths of the Paeth residue: photographs have no repetitions to search for. 3 %
        # larger files in a fifth of the time.
        strategy, residue = imagecodecs.PNG.STRATEGY.RLE, imagecodecs.PNG.FILTER.PAETH
        codes = np.ascontiguousarray(codes)
        png = imagecodecs.png_encode(codes, level=1, strategy=strategy, filter=residue)
        title = SPACES[development.kind.space].title.encode("latin-1")
        profile = _chunk(b"iCCP", title + b"\0\0" + zlib.compress(development.icc))
        file.write(b"".join((png[:_PNG_START], profile, exif, png[_PNG_START:])))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


class JpegXl(Format):
    """JPEG XL; without a quality nothing is lost."""

    name = "jxl"
    spaces: ClassVar = {"srgb": (8,), "linear-srgb": (32,)}
    about = "JPEG XL, without loss unless it has a quality"
    has_quality = True
    memory_per_pixel = 60.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        (samples,), quality = bands, development.kind.quality
        if quality in (None, LOSSLESS):
            effort = _FLOAT_EFFORT if samples.dtype.kind == "f" else _INTEGER_EFFORT
            how: dict[str, Any] = {"lossless": True, "effort": effort}
        else:
            how = {"distance": _distance(quality), "effort": _LOSSY_EFFORT}
        picture = imagecodecs.jpegxl_encode(samples, usecontainer=True, **how)
        start, exif = picture.index(_STREAM) - 4, bytes(4) + encode_tiff(development.directory)
        box = struct.pack(">I4s", 8 + len(exif), b"Exif") + exif
        file.write(picture[:start] + box + picture[start:])


def _distance(quality: int) -> float:
    """Distance in just noticeable differences (libjxl, JxlEncoderDistanceFromQuality)."""
    if quality >= 30:
        return 0.1 + 0.09 * (LOSSLESS - quality)
    return 53 / 3000 * quality**2 - 23 / 20 * quality + 25


class OpenExr(Format):
    """OpenEXR; 16 bits are half floats.

    Raises OutputError if a temporary file cannot be written.
    """

    name = "exr"
    spaces: ClassVar = {"linear-srgb": (16, 32), CAMERA: (32, 16)}
    memory_per_pixel = 40.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        import OpenEXR

        (pixels,), kind, compression = bands, development.kind, OpenEXR.NO_COMPRESSION
        if kind.bits == 16:
            largest = float(np.finfo(np.float16).max)
            with np.errstate(under="ignore"):  # whatever the caller's program asks for
                pixels = pixels.clip(-largest, largest).astype(np.float16)
            # ZIP saves 40 % of half floats, but only 5 % of floats (their last bits are noise), for
            # which it takes too long.
            compression = OpenEXR.ZIP_COMPRESSION
        attributes = _attributes(development.noted, kind.space)
        header = {"compression": compression, "type": OpenEXR.scanlineimage, **attributes}
        planes = np.ascontiguousarray(np.moveaxis(pixels, -1, 0))
        channels = dict(zip(development.channels, planes, strict=True))
        try:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "picture.exr"  # OpenEXR before 3.5 writes to no stream
                OpenEXR.File(header, channels).write(str(path))
                data = path.read_bytes()
        except (OSError, RuntimeError) as error:
            remedy = "set TMPDIR to a folder with free space"
            raise OutputError(f"no temporary file for OpenEXR ({error}); {remedy}") from error
        file.write(data)


def _attributes(metadata: CaptureMetadata, space: str) -> dict[str, Any]:
    """The capture data, and the chromaticities if they are known."""
    attributes: dict[str, Any] = {
        "cameraMake": metadata.make,
        "cameraModel": metadata.model,
        "lensModel": metadata.lens,
        "owner": metadata.artist,
        "copyright": metadata.copyright,
        "comments": metadata.description,
        "capDate": metadata.taken and metadata.taken.strftime("%Y:%m:%d %H:%M:%S"),
        "expTime": metadata.exposure_time,
        "aperture": metadata.f_number,
        "isoSpeed": metadata.iso and float(metadata.iso),
        "nominalFocalLength": metadata.focal_length,
    }
    attributes = {name: value for name, value in attributes.items() if value}
    if metadata.place:
        attributes["latitude"], attributes["longitude"] = metadata.place
    if metadata.altitude is not None:
        attributes["altitude"] = metadata.altitude
    attributes["software"] = software()
    if space in SPACES:
        attributes["chromaticities"] = tuple(chain(*SPACES[space].primaries, D65_XY))
    else:  # not a standard name, but OpenImageIO reads it
        attributes["Orientation"] = metadata.orientation
    return attributes


class NumPy(Format):
    """NumPy, version 1.0."""

    name = "npy"
    spaces: ClassVar = {CAMERA: (32,), "srgb": (32,), "display-p3": (32,), "linear-srgb": (32,)}
    memory_per_pixel = 28.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        (pixels,) = bands
        # `np.save` would not say why a file cannot be written
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(pixels))
        file.write(pixels.data)
