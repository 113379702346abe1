"""Raw frames as a sensor's driver hands them on: where the samples lie in the bytes, and where one frame ends.

The packed formats are those of MIPI CSI-2 (data types RAW10 and RAW12), which V4L2 and libcamera keep in memory as they come over
the wire. The colour letters in their names (SRGGB10P 'pRAA', SBGGR10P 'pBAA', Y10P; libcamera: SRGGB10_CSI2P, R10_CSI2P) say which
filters the driver believes in and are of no concern here: the packing is the same.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from time import monotonic
from typing import Protocol

import numpy as np

from shared.arrays import CodeArray
from shared.dng.tags import LONGEST_SIDE
from shared.errors import InputError
from shared.reading import MAX_PIXELS

_MOST_BYTES = 4  # of memory a pixel of the largest frame may take, with all padding
_STRIP = 16  # rows unpacked at a time: they stay in the cache, which makes it twice as fast


@dataclass(frozen=True)
class _Packing:
    """`pixels` samples of `bits` bits in `length` bytes."""

    bits: int
    pixels: int
    length: int


FORMATS = {
    # V4L2_PIX_FMT_SRGGB10P: four bytes with the upper 8 bits of four pixels, a fifth with their lower 2, the first pixel's lowest.
    "raw10": _Packing(bits=10, pixels=4, length=5),
    # V4L2_PIX_FMT_SRGGB12P: two bytes with the upper 8 bits of two pixels, a third with their lower 4, the first pixel's lowest.
    "raw12": _Packing(bits=12, pixels=2, length=3),
    # V4L2_PIX_FMT_SRGGB16 ('RG16'), and SRGGB10 ('RG10'), SRGGB12 ('RG12'), which use the lower bits only: a little-endian word.
    "u16": _Packing(bits=16, pixels=1, length=2),
}
# What libcamera, V4L2 and their tools call them; with the bits where the name says.
_OTHER_NAMES = {
    r"S(RGGB|BGGR|GRBG|GBRG)(?P<bits>10)(P|_CSI2P)|R10_CSI2P|Y10P|p[RgGB]AA": "raw10",
    r"S(RGGB|BGGR|GRBG|GBRG)(?P<bits>12)(P|_CSI2P)|R12_CSI2P|Y12P|p[RgGB]CC": "raw12",
    r"(SRGGB|SBGGR|SGRBG|SGBRG|RG|BA|GB|BG|GR|R|Y)(?P<bits>10|12|14|16)|BYR2": "u16",
}


def format_named(name: str) -> tuple[str, int]:
    """The key of FORMATS that `name` means, itself or a name of V4L2 or libcamera, and the bits of a sample.

    Raises InputError for any other.
    """
    if name in FORMATS:
        return name, FORMATS[name].bits
    for pattern, meant in _OTHER_NAMES.items():
        if found := re.fullmatch(pattern, name):
            return meant, int(found["bits"] or FORMATS[meant].bits)
    if "PISP_COMP" in name:
        raise InputError(
            f"the format {name} is a lossy compression; ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U"
        )
    raise InputError(f"the format {name!r} is unknown; one of {', '.join(FORMATS)}, or its name in V4L2 or libcamera")


@dataclass(frozen=True)
class FrameLayout:
    """Where the samples of a frame lie: `height` lines of `stride` bytes, the first of which hold `width` samples in `format`.

    format: "raw10", "raw12" (MIPI CSI-2 packed) or "u16" (little-endian words).
    stride: bytes from one line to the next; 0 = no padding between them. (rpicam-raw and v4l2-ctl say what it is; on a Raspberry Pi
        it is a multiple of 32 or more.)
    Raises InputError for a size that no frame has, and for a stride too short for a line.
    """

    width: int
    height: int
    format: str
    stride: int = 0

    def __post_init__(self) -> None:
        if self.format not in FORMATS:
            raise InputError(f"the format {self.format!r} is unknown; one of {', '.join(FORMATS)}")
        for name, side in (("width", self.width), ("height", self.height)):
            if not 1 <= side <= LONGEST_SIDE:
                raise InputError(f"the {name} is {side} pixels, expected 1 to {LONGEST_SIDE}")
        if not self.stride:
            object.__setattr__(self, "stride", self.line_bytes)
        if self.stride < self.line_bytes:
            raise InputError(
                f"the stride is {self.stride} bytes, but a line of {self.width} pixels in {self.format} has {self.line_bytes}"
            )

        if self.frame_bytes > _MOST_BYTES * MAX_PIXELS:
            raise InputError(f"a frame of {self.height} lines of {self.stride} bytes is larger than any sensor's")

    @property
    def bits(self) -> int:
        """Bits of a sample, at most."""
        return FORMATS[self.format].bits

    @property
    def line_bytes(self) -> int:
        """Bytes of a line without its padding; a group of packed pixels is whole even where the line ends within it."""
        packing = FORMATS[self.format]
        return -(-self.width // packing.pixels) * packing.length

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return self.height * self.stride

    def unpack(self, data: bytes | bytearray | memoryview) -> CodeArray:
        """The samples of one frame, uint16 (height, width). Raises InputError when `data` is not `frame_bytes` long."""
        if len(data) != self.frame_bytes:
            raise InputError(self.misfit(len(data)))
        lines = np.frombuffer(data, np.uint8).reshape(self.height, self.stride)[:, : self.line_bytes]
        if self.format == "u16":
            return np.ascontiguousarray(lines).view("<u2").astype(np.uint16, copy=False)
        packing = FORMATS[self.format]
        groups = np.empty((self.height, self.line_bytes // packing.length, packing.pixels), np.uint16)
        # All samples of a group as one integer, so that a table adds their lower bits in one go.
        whole = groups.view(f"u{2 * packing.pixels}")[..., 0]
        for top in range(0, self.height, _STRIP):
            rows = slice(top, top + _STRIP)
            packed = lines[rows].reshape(-1, groups.shape[1], packing.length)
            for pixel in range(packing.pixels):
                groups[rows, :, pixel] = packed[..., pixel]
            groups[rows] <<= packing.bits - 8
            whole[rows] |= self._lower_bits[packed[..., -1]]
        return groups.reshape(self.height, -1)[:, : self.width]

    def misfit(self, length: int) -> str:
        """What is wrong with a frame of `length` bytes, and what may be the reason."""
        told = (
            f"{length} bytes are not a frame: {self.width} x {self.height} pixels in {self.format} "
            f"with a stride of {self.stride} have {self.frame_bytes}"
        )
        stride, rest = divmod(length, self.height)
        if length > self.frame_bytes and length % self.frame_bytes == 0:
            return f"{told}; {length // self.frame_bytes} frames in one are a stream: give it on standard input"
        return f"{told}; a stride of {stride} would fit" if not rest and stride > self.line_bytes else told

    @cached_property
    def _lower_bits(self) -> np.ndarray[tuple[int], np.dtype[np.unsignedinteger]]:
        """What the last byte of a group adds to its samples, for each of its 256 values: all samples as one integer."""
        packing = FORMATS[self.format]
        lower = packing.bits - 8
        shifts = lower * np.arange(packing.pixels)
        samples = (np.arange(256)[:, None] >> shifts & ((1 << lower) - 1)).astype(np.uint16)
        table: np.ndarray[tuple[int], np.dtype[np.unsignedinteger]] = samples.view(f"u{2 * packing.pixels}")[:, 0]
        return table


@dataclass(frozen=True, eq=False)
class RawFrame:
    """The bytes of one frame. taken: UTC; arrived: seconds of the monotonic clock; source: the file it was read from, if any."""

    data: bytes | bytearray | memoryview
    taken: datetime
    arrived: float
    source: str = ""

    @classmethod
    def now(cls, data: bytes | bytearray | memoryview) -> "RawFrame":
        """A frame that has just come."""
        return cls(data, datetime.now(UTC), monotonic())


class ByteStream(Protocol):
    """An unbuffered file: a buffered one would wait for more than is there."""

    def readinto(self, buffer: memoryview, /) -> int | None:
        """As `io.RawIOBase` has it; 0 at the end."""


def read_frames(stream: ByteStream, layout: FrameLayout) -> Iterator[RawFrame]:
    """The frames of a stream that has nothing between them, each as soon as it is there.

    Raises InputError, after the last whole frame, when the stream ends in the middle of one, holds none, or cannot be read.
    """
    count = 0
    while True:
        data = memoryview(bytearray(layout.frame_bytes))
        filled = 0
        while filled < len(data):
            try:
                length = stream.readinto(data[filled:])
            except OSError as error:
                raise InputError(f"the stream cannot be read ({error.strerror or error}) after {count} whole frames") from None
            if not length:
                break
            filled += length
        if filled < len(data):
            break
        count += 1
        yield RawFrame.now(data)
    if filled:
        raise InputError(
            f"the stream ended in the middle of a frame, {filled} bytes after {count} whole ones; a frame has {len(data)}: "
            f"{layout.width} x {layout.height} in {layout.format} with a stride of {layout.stride}"
        )
    if not count:
        raise InputError("the stream ended before the first frame: did the camera start?")
