"""JPEG XL files (ISO/IEC 18181) that say which colours they hold.

The codec labels pixels by their type alone: 8 bits as sRGB, all others as linear light. So the header of its codestream is
replaced by one with the bits and colours of the space, which all have names in JPEG XL and need no ICC profile. The data behind
the header stay as they are: without loss they are the samples; with loss they are in a colour space of JPEG XL's own, from which
a reader converts them to what the header says.
"""

import struct
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray, strips
from shared.colorimetry import decode_srgb
from shared.display import SPACES
from shared.errors import InputError
from shared.tiff import encode_tiff

from ..development import Development
from .format import Format

LOSSLESS = 100
"""The quality of a JPEG XL without loss."""

# Of floating point, libjxl 0.7 (Ubuntu 24.04, Debian 12) cannot decode what effort 1 and 2 make of negative values.
_INTEGER_EFFORT, _FLOAT_EFFORT, _LOSSY_EFFORT = 1, 3, 5
_HEADER = 64  # bytes in which the header of a codestream ends at the latest
_STREAM = b"jxlc"  # the box with the codestream

# ISO/IEC 18181-1, annex D: two bits choose one of four pairs (offset, bits of what is added to it).
_Choices = tuple[tuple[int, int], ...]
_SIDE: _Choices = ((1, 9), (1, 13), (1, 18), (1, 30))
_INTEGER_BITS: _Choices = ((8, 0), (10, 0), (12, 0), (1, 6))
_FLOAT_BITS: _Choices = ((32, 0), (16, 0), (24, 0), (1, 6))
_EXTRA_CHANNELS: _Choices = ((0, 0), (1, 0), (2, 4), (1, 12))
_NAME: _Choices = ((0, 0), (1, 0), (2, 4), (18, 6))
# Annex E: names of colours.
_RGB, _D65, _LINEAR, _SRGB_CURVE, _RELATIVE = 0, 1, 8, 13, 1
_PRIMARIES = {"srgb": 1, "linear-srgb": 1, "display-p3": 11}
_EXPONENT_BITS = 8  # of a float32


class JpegXl(Format):
    """JPEG XL; without a quality nothing is lost."""

    name = "jxl"
    spaces: ClassVar = {"srgb": (16, 8), "display-p3": (16, 8), "linear-srgb": (32,)}
    about = "JPEG XL, without loss unless it has a quality"
    has_quality = True
    memory_per_pixel = 60.0

    @property
    def missing(self) -> str:
        """See `Format`."""
        if imagecodecs.JPEGXL.available:
            return ""
        return "the installed imagecodecs has no JPEG XL; install that of PyPI (pip install -U imagecodecs), or use tif"

    def encode(self, file: BinaryIO, bands: Iterable[NDArray[Any]], development: Development, threads: int) -> None:
        """See `Format`."""
        (samples,), kind = bands, development.kind
        file.write(encode_jpegxl(samples, kind.space, exif=encode_tiff(development.directory), quality=kind.quality))


def encode_jpegxl(samples: NDArray[Any], space: str, *, exif: bytes, quality: int | None = None) -> bytes:
    """Return a JPEG XL file.

    samples: (H, W, 3) of the space: uint8, uint16, or float32 of any finite values.
    space: a key of `SPACES`.
    exif: a TIFF with the capture data.
    quality: None or 100 = without loss; 1 to 99 as of a JPEG, 90 = a loss that can just be noticed.
    """
    samples = np.ascontiguousarray(samples)
    if quality in (None, LOSSLESS):
        effort = _FLOAT_EFFORT if samples.dtype.kind == "f" else _INTEGER_EFFORT
        file = imagecodecs.jpegxl_encode(samples, lossless=True, effort=effort, usecontainer=True)
    else:
        light = samples if SPACES[space].linear else _linear_srgb(samples, space)
        file = imagecodecs.jpegxl_encode(light, distance=_distance(quality), effort=_LOSSY_EFFORT, usecontainer=True)
    boxes = dict(_boxes(memoryview(file)))
    stream = _relabelled(boxes.pop(_STREAM), samples.dtype, space)
    first = (_box(name, content) for name, content in boxes.items())
    return b"".join((*first, _box(b"Exif", bytes(4), exif), _box(_STREAM, *stream)))


def _distance(quality: int) -> float:
    """How much may be lost, in differences that can just be noticed (libjxl, JxlEncoderDistanceFromQuality)."""
    if quality >= 30:
        return 0.1 + 0.09 * (LOSSLESS - quality)
    return 53 / 3000 * quality**2 - 23 / 20 * quality + 25


def _linear_srgb(codes: NDArray[Any], space: str) -> FloatArray:
    """Linear light in the primaries of sRGB, float32; colours that these do not reach have negative values."""
    to_srgb = np.linalg.solve(SPACES["srgb"].to_xyz, SPACES[space].to_xyz)
    light = np.empty(codes.shape, np.float32)
    for rows in strips(len(codes)):
        light[rows] = decode_srgb(codes[rows] / np.iinfo(codes.dtype).max) @ to_srgb.T
    return light


def _boxes(file: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """The boxes of a file (ISO/IEC 18181-2): name and content."""
    while file:
        size, head = int.from_bytes(file[:4], "big"), 8
        if size == 1:
            size, head = int.from_bytes(file[8:16], "big"), 16
        end = size or len(file)
        yield bytes(file[4:8]), file[head:end]
        file = file[end:]


def _box(name: bytes, *contents: bytes | memoryview) -> bytes:
    size = 8 + sum(map(len, contents))
    head = struct.pack(">I4s", size, name) if size < 1 << 32 else struct.pack(">I4sQ", 1, name, size + 8)
    return b"".join((head, *contents))


def _relabelled(stream: memoryview, dtype: np.dtype[Any], space: str) -> tuple[bytes, memoryview]:
    """A codestream with a header that names this type and space: the header, and the data behind it."""
    bits = _Bits(stream)
    bits.take(16)  # signature
    _skip_size(bits)
    size = bits.place, bits.passed()
    modular, xyb = _read_metadata(bits)
    known = (dtype.kind == "f", modular, xyb)
    return _packed([size, *_metadata(8 * dtype.itemsize, space, *known)]), stream[-(-bits.place // 8) :]


class _Bits:
    """Reads numbers from the header of a codestream, lowest bits first."""

    def __init__(self, stream: memoryview) -> None:
        self._all, self.place = int.from_bytes(stream[:_HEADER], "little"), 0

    def take(self, count: int) -> int:
        value = (self._all >> self.place) & ((1 << count) - 1)
        self.place += count
        return value

    def choose(self, choices: _Choices) -> int:
        offset, count = choices[self.take(2)]
        return offset + self.take(count)

    def passed(self) -> int:
        """Everything up to here, as one number."""
        return self._all & ((1 << self.place) - 1)


def _skip_size(bits: _Bits) -> None:
    small = bits.take(1)
    for side in range(2):
        if side and bits.take(3):  # a usual ratio stands for the width
            return
        _ = bits.take(5) if small else bits.choose(_SIDE)


def _read_metadata(bits: _Bits) -> tuple[int, int]:
    """Whether samples fit 16 bits, and whether they are in JPEG XL's own colours. Raises InputError for an unknown header."""
    modular = xyb = 1
    strange = 0
    if not bits.take(1):
        strange |= bits.take(1)  # orientation, animation, tone mapping
        if bits.take(1):
            bits.choose(_FLOAT_BITS)
            bits.take(4)
        else:
            bits.choose(_INTEGER_BITS)
        modular = bits.take(1)
        strange |= bits.choose(_EXTRA_CHANNELS)
        xyb = bits.take(1)
        if not bits.take(1):
            strange |= bits.take(1) | bits.choose(_NAME)  # an ICC profile; no RGB
            bits.choose(_NAME), bits.choose(_NAME)
            strange |= bits.take(1)  # a power instead of a named curve
            bits.choose(_NAME), bits.choose(_NAME)
        strange |= bits.take(2)  # extensions
    if strange or not bits.take(1):
        raise InputError(f"the JPEG XL codec ({imagecodecs.jpegxl_version()}) writes a header of another kind; use tif")
    return modular, xyb


def _metadata(depth: int, space: str, floating: bool, modular: int, xyb: int) -> list[tuple[int, int]]:
    """The header behind the size, as (bits, value): annexes D.3 and E.2."""
    exponent = [(4, _EXPONENT_BITS - 1)] if floating else []
    curve = _LINEAR if SPACES[space].linear else _SRGB_CURVE
    return [
        *((1, 0), (1, 0), (1, int(floating)), *_chosen(depth, _FLOAT_BITS if floating else _INTEGER_BITS), *exponent),
        *((1, modular), *_chosen(0, _EXTRA_CHANNELS), (1, xyb)),
        *((1, 0), (1, 0), *_chosen(_RGB, _NAME), *_chosen(_D65, _NAME), *_chosen(_PRIMARIES[space], _NAME)),
        *((1, 0), *_chosen(curve, _NAME), *_chosen(_RELATIVE, _NAME)),
        *((2, 0), (1, 1)),
    ]


def _chosen(value: int, choices: _Choices) -> list[tuple[int, int]]:
    """A number as the first of the four choices that can hold it."""
    for index, (offset, count) in enumerate(choices):
        if 0 <= value - offset < 1 << count:
            return [(2, index), (count, value - offset)]
    raise ValueError(value)


def _packed(fields: list[tuple[int, int]]) -> bytes:
    value = place = 0
    for count, number in fields:
        value |= number << place
        place += count
    return value.to_bytes(-(-place // 8), "little")
