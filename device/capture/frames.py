"""Raw frames as a camera driver delivers them: where the samples are in the bytes, and where a frame ends.

Packed formats are those of MIPI CSI-2 (data types RAW10, RAW12 and RAW14), which V4L2 and libcamera keep in memory as transmitted,
and those of machine vision (GenICam PFNC 2.4; "Packed" in GigE Vision 1). The colour letters in names (SRGGB10P 'pRAA';
libcamera: SRGGB10_CSI2P) state the filters that the driver assumes. They are ignored here: the packing is the same.
"""

import re
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from io import RawIOBase
from itertools import product
from time import monotonic
from typing import Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from shared.arrays import ByteArray, CodeArray, is_frozen
from shared.dng.tags import LONGEST_SIDE
from shared.errors import InputError
from shared.reading import MAX_PIXELS
from shared.spelling import meant

_MOST_BYTES = 4  # per pixel of the largest frame, with all padding
_ALIGNMENTS = (1, 16, 32, 64, 128, 256)  # bytes, to a multiple of which drivers pad lines
_SPARE = 2
_STRIP = 32  # rows unpacked at a time; they fit into the cache


@dataclass(frozen=True)
class _Packing:
    """`pixels` samples of `bits` bits in `length` bytes.

    names: a pattern of the names of the format elsewhere, with the bits if they state them.
    place: (sample of the group, its bit) -> the bit of the group, both from the lowest bit of the first byte on; None = words.
    words: how NumPy names them.
    """

    bits: int
    pixels: int
    length: int
    names: str
    place: Callable[[int, int], int] | None = None
    words: str = ""

    @property
    def word(self) -> np.dtype[Any]:
        """The words that hold a group, packed and unpacked: 16 bits for each of its samples."""
        return np.dtype(f"<u{2 * self.pixels}")

    @cached_property
    def moves(self) -> dict[int, int]:
        """How a packed word becomes an unpacked one: bits to shift up by (negative: down) -> mask of the bits that move so far."""
        masks: dict[int, int] = {}
        for sample, bit in product(range(self.pixels), range(self.bits)):
            at = self.place(sample, bit) if self.place else 0
            by = 16 * sample + bit - at
            masks[by] = masks.get(by, 0) | 1 << at
        return masks


def _mipi(bits: int, pixels: int, names: str) -> _Packing:
    """A byte with the upper 8 bits of each pixel, then the lower bits of all, the first pixel's lowest."""
    low = bits - 8
    return _Packing(
        bits, pixels, pixels * bits // 8, names, lambda k, bit: 8 * k + bit - low if bit >= low else 8 * pixels + low * k + bit
    )


def _stream(bits: int, pixels: int, names: str) -> _Packing:
    """One pixel behind the other, the lowest bits first."""
    return _Packing(bits, pixels, pixels * bits // 8, names, lambda k, bit: bits * k + bit)


def _gige(bits: int, names: str) -> _Packing:
    """The upper 8 bits of two pixels, and between them a byte with the lower bits, of each in half a byte."""
    low = bits - 8
    return _Packing(bits, 2, 3, names, lambda k, bit: 16 * k + bit - low if bit >= low else 8 + 4 * k + bit)


_ORDERS = "(RGGB|BGGR|GRBG|GBRG)"
_PFNC = "(Mono|SCF1(WBWG|WGWB|WGWR|WRWG))"
FORMATS = {
    "raw10": _mipi(10, 4, rf"S{_ORDERS}10(P|_CSI2P)|R10_CSI2P|Y10P|p[RgGB]AA"),
    "raw12": _mipi(12, 2, rf"S{_ORDERS}12(P|_CSI2P)|R12_CSI2P|Y12P|p[RgGB]CC"),
    "raw14": _mipi(14, 4, rf"S{_ORDERS}14(P|_CSI2P)|R14_CSI2P|Y14P|p[RgGB]EE"),
    "mono10p": _stream(10, 4, f"{_PFNC}10p"),
    "mono12p": _stream(12, 2, f"{_PFNC}12p"),
    "mono14p": _stream(14, 4, f"{_PFNC}14p"),
    "mono10packed": _gige(10, f"{_PFNC}10Packed"),
    "mono12packed": _gige(12, f"{_PFNC}12Packed"),
    "u8": _Packing(8, 1, 1, rf"uint8|raw8|S{_ORDERS}8|BA81|{_ORDERS}|GREY|[RY]8|{_PFNC}8", words="u1"),
    "u16": _Packing(16, 1, 2, rf"(S{_ORDERS}|RG|BA|GB|BG|GR|R|Y|{_PFNC})(?P<bits>10|12|14|16)|BYR2|raw16|uint16", words="<u2"),
    "u16be": _Packing(16, 1, 2, r"Y(?P<bits>10|12|14|16)[_-]?BE", words=">u2"),
}


def format_named(name: str) -> tuple[str, int]:
    """(key of FORMATS, bits of a sample) of a format. Raises InputError for an unknown one.

    name: a key of FORMATS, or the name of the format in V4L2, libcamera or PFNC (GenICam).
    """
    for ours, packing in FORMATS.items():
        if name == ours:
            return ours, packing.bits
        if found := re.fullmatch(packing.names, name):
            return ours, int(found.groupdict().get("bits") or packing.bits)
    if "PISP_COMP" in name:
        raise InputError(
            f"the format {name} is a lossy compression; ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U"
        )
    raise InputError(
        f"the format {name!r} is unknown; one of {', '.join(FORMATS)}, or its name in V4L2, libcamera or PFNC{meant(name, FORMATS)}"
    )


@dataclass(frozen=True)
class FrameLayout:
    """Size and format of a frame: `height` lines of `stride` bytes, each with `width` samples at its beginning.

    width, height: pixels, 1 to 65500.
    format: a key of FORMATS.
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
    def has_words(self) -> bool:
        """Whether samples are 16-bit words, of which they may use the lower bits only."""
        return self.bits == 16

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

        They are a view of `data` if it is read-only and has them as they are.
        Raises InputError unless `data` is `frame_bytes` long.
        """
        if len(data) != self.frame_bytes:
            raise InputError(self.misfit(len(data)))
        lines = np.frombuffer(data, np.uint8).reshape(self.height, self.stride)[:, : self.line_bytes]
        packing = FORMATS[self.format]
        if packing.words:
            words = lines.view(packing.words)
            if words.dtype == np.uint16 and words.flags.aligned and is_frozen(words):
                return words
        codes = np.empty((self.height, self.width), np.uint16)
        if packing.words:
            codes[:] = words
        else:
            self._unpack_groups(lines, codes)
        codes.flags.writeable = False
        return codes

    def _unpack_groups(self, lines: ByteArray, codes: CodeArray) -> None:
        """Unpack whole groups as words: they are few, and a word is shifted as fast as a byte."""
        packing = FORMATS[self.format]
        padded = np.zeros((_STRIP, self.line_bytes + packing.word.itemsize), np.uint8)  # the last word of a line reaches beyond it
        shape = _STRIP, self.line_bytes // packing.length
        groups: NDArray[Any] = np.ndarray(shape, packing.word, padded, strides=(padded.shape[1], packing.length))
        packed, unpacked, part = (np.empty(shape, packing.word) for _ in range(3))
        for top in range(0, self.height, _STRIP):
            strip = lines[top : top + _STRIP]
            padded[: len(strip), : self.line_bytes] = strip
            packed[:] = groups  # a copy that is aligned
            unpacked[:] = 0
            for by, mask in packing.moves.items():
                np.bitwise_and(packed, packing.word.type(mask), out=part)
                shift = np.left_shift if by > 0 else np.right_shift
                shift(part, packing.word.type(abs(by)), out=part)
                unpacked |= part
            codes[top : top + _STRIP] = unpacked.view("<u2")[: len(strip), : self.width]

    def misfit(self, length: int) -> str:
        """Message that `length` bytes are not a frame, with a likely reason."""
        message = f"{length} bytes are not a frame: {self.size}"
        stride, rest = divmod(length, self.height)
        if length > self.frame_bytes and length % self.frame_bytes == 0:
            return f"{message}; {length // self.frame_bytes} frames in one are a stream: give it on standard input"
        return f"{message}; a stride of {stride} would fit" if not rest and stride > self.line_bytes else message

    def check_recording(self, length: int, advice: str = "") -> None:
        """Raise InputError if a recording of `length` bytes has whole frames of another stride, and not of this one.

        advice: what ends the message.
        """
        if length % self.frame_bytes and (likely := self.likely(length)):
            raise InputError(f"{length} bytes are no whole number of frames: {self.size}; likely {likely}{advice}")

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
    # Memory of frames that nobody needs any more: the system clears what is new to a process, which takes as long as a copy.
    spare: deque[ByteArray] = deque(maxlen=_SPARE)
    while True:
        # Not a bytearray: clearing it would stop the other threads.
        memory = spare.pop() if spare else np.empty(layout.frame_bytes, np.uint8)
        lent = memory[:]  # kept by all that is made of the frame
        finalize(lent, spare.append, memory).atexit = False
        data, filled = lent.data, 0
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
        yield RawFrame.now(data.toreadonly())
    if filled:
        advice = "If the camera was not stopped, its frames have another size, and the shots of this stream are wrong"
        if likely := layout.likely(count * len(data) + filled):
            advice = f"All its bytes are whole frames with {likely}: discard the shots of this stream"
        ended = f"the stream ended in the middle of a frame, {filled} bytes after {count} whole ones"
        raise InputError(f"{ended}; {layout.size}. {advice}")
    if not count:
        raise InputError("the stream ended before the first frame: did the camera start?")
