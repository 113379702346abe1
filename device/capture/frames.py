"""Raw frames as a camera driver delivers them: where the samples are in the bytes, and where a frame ends.

The packed formats are those of MIPI CSI-2 (data types RAW10 and RAW12), which V4L2 and libcamera keep in memory as transmitted. The
colour letters in their names (SRGGB10P 'pRAA', SBGGR10P 'pBAA', Y10P; libcamera: SRGGB10_CSI2P, R10_CSI2P) state the filters that
the driver assumes. They are ignored here: the packing is the same.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from io import RawIOBase
from time import monotonic

import numpy as np

from shared.arrays import ByteArray, CodeArray
from shared.dng.tags import LONGEST_SIDE
from shared.errors import InputError
from shared.reading import MAX_PIXELS
from shared.spelling import meant

_MOST_BYTES = 4  # per pixel of the largest frame, with all padding
_ALIGNMENTS = (1, 16, 32, 64, 128, 256)  # bytes, to a multiple of which drivers pad lines
_STRIP = 16  # rows unpacked at a time; they fit into the cache, which doubles the speed


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
# Our names of these formats and those in libcamera, V4L2 and their tools, with the bits if the name states them.
_NAMES = {
    "raw10": r"raw10|S(RGGB|BGGR|GRBG|GBRG)(?P<bits>10)(P|_CSI2P)|R10_CSI2P|Y10P|p[RgGB]AA",
    "raw12": r"raw12|S(RGGB|BGGR|GRBG|GBRG)(?P<bits>12)(P|_CSI2P)|R12_CSI2P|Y12P|p[RgGB]CC",
    "u16": r"u16|(SRGGB|SBGGR|SGRBG|SGBRG|RG|BA|GB|BG|GR|R|Y|Mono|SCF1[BGRW]{4})(?P<bits>10|12|14|16)|BYR2|raw16|uint16",
}


def format_named(name: str) -> tuple[str, int]:
    """(key of FORMATS, bits of a sample) of a format. Raises InputError for an unknown one.

    name: a key of FORMATS, or the name of the format in V4L2 or libcamera.
    """
    for ours, pattern in _NAMES.items():
        if found := re.fullmatch(pattern, name):
            return ours, int(found["bits"] or FORMATS[ours].bits)
    if "PISP_COMP" in name:
        raise InputError(
            f"the format {name} is a lossy compression; ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U"
        )
    raise InputError(
        f"the format {name!r} is unknown; one of {', '.join(FORMATS)}, or its name in V4L2 or libcamera{meant(name, FORMATS)}"
    )


@dataclass(frozen=True)
class FrameLayout:
    """Size and format of a frame: `height` lines of `stride` bytes, each with `width` samples at its beginning.

    width, height: pixels, 1 to 65500.
    format: "raw10", "raw12" (MIPI CSI-2 packed) or "u16" (little-endian words).
    stride: bytes from one line to the next; 0 = no padding. rpicam-raw and v4l2-ctl print it; on a Raspberry Pi it is a multiple of
        32 or more.
    Raises InputError for a size that no frame has, and for a stride shorter than a line.
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
        """Largest number of bits of a sample."""
        return FORMATS[self.format].bits

    @property
    def line_bytes(self) -> int:
        """Bytes of a line without padding; the last group of packed pixels is always whole."""
        packing = FORMATS[self.format]
        return -(-self.width // packing.pixels) * packing.length

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return self.height * self.stride

    def unpack(self, data: bytes | bytearray | memoryview) -> CodeArray:
        """The samples of one frame, uint16 (height, width), which a `Mosaic` keeps without another copy.

        Raises InputError unless `data` is `frame_bytes` long.
        """
        if len(data) != self.frame_bytes:
            raise InputError(self.misfit(len(data)))
        lines = np.frombuffer(data, np.uint8).reshape(self.height, self.stride)[:, : self.line_bytes]
        codes = np.empty((self.height, self.width), np.uint16)
        if self.format == "u16":
            codes[:] = lines.view("<u2")
        else:
            self._unpack_groups(lines, codes)
        codes.flags.writeable = False
        return codes

    def _unpack_groups(self, lines: ByteArray, codes: CodeArray) -> None:
        packing = FORMATS[self.format]
        groups = np.empty((_STRIP, self.line_bytes // packing.length, packing.pixels), np.uint16)
        # All samples of a group as one integer, so that a table adds their lower bits in one step.
        whole = groups.view(f"u{2 * packing.pixels}")[..., 0]
        for top in range(0, self.height, _STRIP):
            packed = lines[top : top + _STRIP].reshape(-1, groups.shape[1], packing.length)
            count = len(packed)
            for pixel in range(packing.pixels):
                groups[:count, :, pixel] = packed[..., pixel]
            groups <<= packing.bits - 8
            whole[:count] |= self._lower_bits[packed[..., -1]]
            codes[top : top + count] = groups[:count].reshape(count, -1)[:, : self.width]

    def misfit(self, length: int) -> str:
        """Message that `length` bytes are not a frame, with a likely reason."""
        message = f"{length} bytes are not a frame: {self.size}"
        stride, rest = divmod(length, self.height)
        if length > self.frame_bytes and length % self.frame_bytes == 0:
            return f"{message}; {length // self.frame_bytes} frames in one are a stream: give it on standard input"
        return f"{message}; a stride of {stride} would fit" if not rest and stride > self.line_bytes else message

    def check_recording(self, length: int) -> None:
        """Raise InputError if a recording of `length` bytes has whole frames of another stride, and not of this one."""
        if length % self.frame_bytes and (likely := self.likely(length)):
            seen = f"{length} bytes are no whole number of frames: {self.size}"
            raise InputError(f"{seen}; likely {likely}. If they are right, add `unchecked`")

    @property
    def size(self) -> str:
        """Size and format in words, for messages."""
        return f"{self.width} x {self.height} pixels in {self.format} with a stride of {self.stride} have {self.frame_bytes}"

    def likely(self, length: int) -> str:
        """The options with which `length` bytes are whole frames; "" if there are none, or if they would say little."""
        for unit in _ALIGNMENTS:
            stride = -(-self.line_bytes // unit) * unit
            if stride != self.stride and length % (stride * self.height) == 0:
                return f"`stride={stride}`"
        return ""

    @cached_property
    def _lower_bits(self) -> np.ndarray[tuple[int], np.dtype[np.unsignedinteger]]:
        """Lower bits of all samples of a group, as one integer, for each of the 256 values of its last byte."""
        packing = FORMATS[self.format]
        lower = packing.bits - 8
        shifts = lower * np.arange(packing.pixels)
        samples = (np.arange(256)[:, None] >> shifts & ((1 << lower) - 1)).astype(np.uint16)
        return samples.view(f"u{2 * packing.pixels}")[:, 0]


@dataclass(frozen=True, eq=False)
class RawFrame:
    """The bytes of one frame.

    data: its bytes, as `FrameLayout` describes them.
    taken: time of the frame, with time zone.
    arrived: time at which this program received it, on the monotonic clock, seconds.
    source: the file that it was read from; "" = none.
    """

    data: bytes | bytearray | memoryview
    taken: datetime
    arrived: float
    source: str = ""

    @classmethod
    def now(cls, data: bytes | bytearray | memoryview) -> "RawFrame":
        """A frame that has just arrived."""
        return cls(data, datetime.now(UTC), monotonic())


def read_frames(stream: RawIOBase, layout: FrameLayout) -> Iterator[RawFrame]:
    """Yield the frames of a stream without anything between them, each as soon as it has arrived.

    stream: unbuffered; a buffered one would wait for more bytes than have arrived.
    Raises InputError, after the last whole frame, when the stream ends within a frame, holds none, or cannot be read.
    """
    count = 0
    while True:
        data = np.empty(layout.frame_bytes, np.uint8).data  # not a bytearray: clearing it would stop the other threads
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
        advice = "If the camera was not stopped, its frames have another size, and the shots of this stream are wrong"
        if likely := layout.likely(count * len(data) + filled):
            advice = f"All its bytes are whole frames with {likely}: discard the shots of this stream"
        ended = f"the stream ended in the middle of a frame, {filled} bytes after {count} whole ones"
        raise InputError(f"{ended}; {layout.size}. {advice}")
    if not count:
        raise InputError("the stream ended before the first frame: did the camera start?")
