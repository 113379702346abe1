"""Raw frames as a camera driver delivers them: where the samples are in the bytes, and where a
frame ends.

Packed formats are those of MIPI CSI-2 (data types RAW10, RAW12 and RAW14), which V4L2 and libcamera
keep in memory as transmitted, and those of machine vision (GenICam PFNC 2.4; "Packed" in GigE
Vision 1). The colour letters in names (SRGGB10P 'pRAA'; libcamera: SRGGB10_CSI2P) state the filters
that the driver assumes. They are ignored here: the packing is the same.
"""

import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from io import RawIOBase
from itertools import product
from time import monotonic
from typing import Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ...shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from ...shared.arrays import ByteArray, CodeArray, is_frozen
from ...shared.dng.tags import LONGEST_SIDE
from ...shared.errors import InputError, meant
from ...shared.reading import MAX_PIXELS

Bytes = bytes | bytearray | memoryview

_MOST_BYTES = 4  # per pixel of the largest frame, with all padding
_ALIGNMENTS = (1, 16, 32, 64, 128, 256)  # bytes, to a multiple of which drivers pad lines
_SPARE = 2
_STRIP = 32  # rows unpacked at a time; they fit into the cache


class FrameError(InputError):
    """A frame is not as described, or cut off; frames before it may not be right either."""


@dataclass(frozen=True)
class _Packing:
    """A group of `pixels` samples of `bits` bits, in whole bytes.

    names: a pattern of the names of the format elsewhere, with the bits if they state them.
    step, low, tail, between: a sample begins `step` bits after the one before. Its `low` lowest
    bits are not there: those of the first sample begin at bit `tail` of the group, and each other's
    `between` bits further. Bits count from the lowest one of the first byte.
    words: how NumPy names samples that are words; then nothing has to be moved.
    """

    bits: int
    pixels: int
    names: str
    step: int = 0
    low: int = 0
    tail: int = 0
    between: int = 0
    words: str = ""

    @property
    def length(self) -> int:
        """Bytes of a group."""
        return -(-self.bits * self.pixels // 8)

    @property
    def word(self) -> np.dtype[Any]:
        """The words that hold a group, packed and unpacked: 16 bits for each of its samples."""
        return np.dtype(f"<u{2 * self.pixels}")

    @cached_property
    def moves(self) -> dict[int, int]:
        """Moves from a packed word to an unpacked one: bits to shift up by (negative: down) -> mask
        of the bits that move so far.
        """
        masks: dict[int, int] = {}
        for sample, bit in product(range(self.pixels), range(self.bits)):
            above = self.step * sample + bit - self.low
            at = above if bit >= self.low else self.tail + self.between * sample + bit
            by = 16 * sample + bit - at
            masks[by] = masks.get(by, 0) | 1 << at
        return masks


_ORDERS = "(RGGB|BGGR|GRBG|GBRG)"
_PFNC = "(Mono|SCF1(WBWG|WGWB|WGWR|WRWG))"


def _mipi(bits: int, pixels: int, letter: str) -> _Packing:
    """A byte with the upper 8 bits of each pixel, then the lower bits of all, the first pixel's
    lowest.
    """
    names = rf"S{_ORDERS}{bits}(P|_CSI2P)|R{bits}_CSI2P|Y{bits}P|p[RgGB]{letter}{letter}"
    low = bits - 8
    return _Packing(bits, pixels, names, step=8, low=low, tail=8 * pixels, between=low)


def _gige(bits: int) -> _Packing:
    """The upper 8 bits of two pixels, and between them a byte with the lower bits, of each in half
    a byte.
    """
    return _Packing(bits, 2, f"{_PFNC}{bits}Packed", step=16, low=bits - 8, tail=8, between=4)


_WORDS = rf"(S{_ORDERS}|RG|BA|GB|BG|GR|R|Y|{_PFNC})(?P<bits>10|12|14|16)|BYR2|raw16|uint16"
FORMATS = {
    "raw10": _mipi(10, 4, "A"),
    "raw12": _mipi(12, 2, "C"),
    "raw14": _mipi(14, 4, "E"),
    # One pixel behind the other, the lowest bits first.
    "mono10p": _Packing(10, 4, f"{_PFNC}10p", step=10),
    "mono12p": _Packing(12, 2, f"{_PFNC}12p", step=12),
    "mono14p": _Packing(14, 4, f"{_PFNC}14p", step=14),
    "mono10packed": _gige(10),
    "mono12packed": _gige(12),
    "u8": _Packing(8, 1, rf"uint8|raw8|S{_ORDERS}8|BA81|{_ORDERS}|GREY|[RY]8|{_PFNC}8", words="u1"),
    "u16": _Packing(16, 1, _WORDS, words="<u2"),
    "u16be": _Packing(16, 1, r"Y(?P<bits>10|12|14|16)[_-]?BE", words=">u2"),
}


def format_named(name: str) -> tuple[str, int]:
    """(key of FORMATS, bits of a sample) of a format.

    Parameters
    ----------
    name : str
        A key of FORMATS, or the name of the format in V4L2, libcamera or PFNC (GenICam).

    Raises
    ------
    InputError
        For an unknown one.
    """
    for ours, packing in FORMATS.items():
        if found := re.fullmatch(f"{ours}|{packing.names}", name):
            return ours, int(found.groupdict().get("bits") or packing.bits)
    if "PISP_COMP" in name:
        remedy = "ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U"
        raise InputError(f"the format {name} is a lossy compression; {remedy}")
    others = f"or its name in V4L2, libcamera or PFNC{meant(name, FORMATS)}"
    raise InputError(f"the format {name!r} is unknown; one of {', '.join(FORMATS)}, {others}")


@dataclass(frozen=True)
class FrameLayout:
    """Size and format of a frame: `height` lines of `stride` bytes, each with `width` samples at
    its beginning.

    Attributes
    ----------
    width, height : int
        Pixels, 1 to 65500.
    format : str
        A key of FORMATS.
    stride : int
        Bytes from one line to the next; 0 = no padding. rpicam-raw and v4l2-ctl print it; on a
        Raspberry Pi it is a multiple of 32 or more.

    Raises
    ------
    InputError
        For a size that no frame has, and for a stride shorter than a line.

    Examples
    --------
    >>> from panchroma.device.capture import FrameLayout
    >>> FrameLayout(4, 1, "raw12").unpack(bytes([0x80, 0x40, 0x21, 0, 0, 0])).tolist()
    [[2049, 1026, 0, 0]]
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
            line = f"but a line of {self.width} pixels in {self.format} has {self.line_bytes}"
            raise InputError(f"the stride is {self.stride} bytes, {line}")
        if self.frame_bytes > _MOST_BYTES * MAX_PIXELS:
            frame = f"a frame of {self.height} lines of {self.stride} bytes"
            raise InputError(f"{frame} is larger than any sensor's")

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

    def unpack(self, data: Bytes) -> CodeArray:
        """The samples of one frame, uint16 (height, width), which a `Mosaic` keeps without another
        copy.

        They are a view of `data` if it is read-only and has them as they are.

        Raises
        ------
        InputError
            Unless `data` is `frame_bytes` long.
        """
        if len(data) != self.frame_bytes:
            raise InputError(self.misfit(len(data)))
        lines = np.frombuffer(data, np.uint8).reshape(self.height, self.stride)
        lines = lines[:, : self.line_bytes]
        packing = FORMATS[self.format]
        if packing.words:
            words = lines.view(packing.words)
            if words.dtype == np.uint16 and words.flags.aligned and is_frozen(words):
                return words
            codes = words.astype(np.uint16)
        else:
            codes = self._unpack_groups(lines)
        codes.flags.writeable = False
        return codes

    def _unpack_groups(self, lines: ByteArray) -> CodeArray:
        """Codes of whole groups, unpacked as words: they are few, and a word is shifted as fast as
        a byte.
        """
        packing, codes = FORMATS[self.format], np.empty((self.height, self.width), np.uint16)
        # the last word of a line reaches beyond it
        padded = np.zeros((_STRIP, self.line_bytes + packing.word.itemsize), np.uint8)
        shape = _STRIP, self.line_bytes // packing.length
        strides = padded.shape[1], packing.length
        groups: NDArray[Any] = np.ndarray(shape, packing.word, padded, strides=strides)
        packed, unpacked, field = (np.empty(shape, packing.word) for _ in range(3))
        for top in range(0, self.height, _STRIP):
            strip = lines[top : top + _STRIP]
            padded[: len(strip), : self.line_bytes] = strip
            packed[:] = groups  # a copy that is aligned
            unpacked[:] = 0
            for by, mask in packing.moves.items():
                np.bitwise_and(packed, packing.word.type(mask), out=field)
                shift = np.left_shift if by > 0 else np.right_shift
                unpacked |= shift(field, packing.word.type(abs(by)), out=field)
            codes[top : top + _STRIP] = unpacked.view("<u2")[: len(strip), : self.width]
        return codes

    def misfit(self, length: int) -> str:
        """Message that `length` bytes are not a frame, with a likely reason."""
        message = f"{length} bytes are not a frame: {self.size}"
        count, rest = divmod(length, self.frame_bytes)
        if count > 1 and not rest:
            return f"{message}; {count} frames in one are a stream: give it on standard input"
        stride, rest = divmod(length, self.height)
        fits = stride > self.line_bytes and not rest
        return f"{message}; a stride of {stride} would fit" if fits else message

    def check_recording(self, length: int, advice: str = "") -> None:
        """Raise InputError if a recording of `length` bytes has whole frames of another stride, and
        not of this one.

        Parameters
        ----------
        advice : str, optional
            What ends the message.
        """
        if length % self.frame_bytes and (likely := self.likely(length)):
            hint = f"likely {likely}{advice}"
            raise InputError(f"{length} bytes are no whole number of frames: {self.size}; {hint}")

    @property
    def size(self) -> str:
        """Size and format in words, for messages."""
        pixels = f"{self.width} x {self.height} pixels in {self.format}"
        return f"{pixels} with a stride of {self.stride} have {self.frame_bytes}"

    def likely(self, length: int) -> str:
        """The options with which `length` bytes are whole frames; "" if there are none, or if they
        would say little.
        """
        for unit in _ALIGNMENTS:
            stride = -(-self.line_bytes // unit) * unit
            if stride != self.stride and length % (stride * self.height) == 0:
                return f"`stride={stride}`"
        return ""


@dataclass(frozen=True, eq=False)
class RawFrame:
    """The bytes of one frame.

    Attributes
    ----------
    data : Bytes
        Its bytes, as `FrameLayout` describes them.
    taken : datetime
        Time of the frame, with time zone.
    arrived : float
        Time at which this program received it, on the monotonic clock, seconds.
    source : str
        The file that it was read from; "" = none.
    is_checked : bool
        It shows the filters where its description says: no byte was lost before it. False: it does
        not show that.

    Examples
    --------
    >>> from panchroma.device.capture import RawFrame
    >>> frame = RawFrame.now(bytes(48))
    >>> len(frame.data), frame.taken.tzinfo is None
    (48, False)
    """

    data: Bytes
    taken: datetime
    arrived: float
    source: str = ""
    is_checked: bool = False

    @classmethod
    def now(cls, data: Bytes) -> "RawFrame":
        """A frame that has just arrived."""
        return cls(data, datetime.now(UTC), monotonic())

    def named(self, error: InputError) -> str:
        """The message of an error of this frame, with the file in front."""
        return f"{self.source}: {error}" if self.source else str(error)


@dataclass(frozen=True)
class Sensor:
    """The sensor whose frames are captured.

    Attributes
    ----------
    layout : FrameLayout
        Size and format of its frames.
    pattern : CfaPattern
        Its filter pattern.
    calibration : SensorCalibration
        Its calibration, for the mode in which it runs.
    metadata : CaptureMetadata
        What every shot records besides its time.

    Raises
    ------
    InputError
        When pattern and calibration have different channels, when a frame holds no whole colour
        block, and when the bits of the calibration do not fit the format: then the calibration
        belongs to another mode of the sensor.

    Examples
    --------
    >>> from panchroma.device.capture import FrameLayout, Sensor
    >>> from panchroma.shared import CfaPattern, SensorCalibration
    >>> layout = FrameLayout(4056, 3040, "raw12", stride=6112)
    >>> sensor = Sensor(layout, CfaPattern.bayer(6), SensorCalibration.of_bits(12))
    >>> sensor.dark().shape
    (3040, 4056)
    """

    layout: FrameLayout
    pattern: CfaPattern
    calibration: SensorCalibration
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)

    def __post_init__(self) -> None:
        bits = self.calibration.bits
        # samples of 16-bit words may use the lower bits only
        if bits > self.layout.bits or bits != self.layout.bits < 16:
            both = f"samples of {bits} bits, {self.layout.format} has {self.layout.bits}"
            reason = "they belong to different modes of the sensor"
            raise InputError(f"the calibration is for {both}: {reason}")
        self.dark()

    def dark(self) -> Mosaic:
        """A frame without light, for preparations before the first frame arrives."""
        black = round(min(self.calibration.black_level))
        codes = np.full((self.layout.height, self.layout.width), black, np.uint16)
        return Mosaic(codes, self.pattern, self.calibration)

    def mosaic(self, frame: RawFrame) -> Mosaic:
        """The mosaic of a frame.

        Raises
        ------
        InputError
            When the frame does not fit the sensor.
        """
        local = frame.taken.astimezone()
        taken, zone = local.replace(tzinfo=None), local.isoformat()[-6:]
        metadata = replace(self.metadata, taken=taken, zone=zone)
        return Mosaic(self.layout.unpack(frame.data), self.pattern, self.calibration, metadata)


def read_frames(stream: RawIOBase, layout: FrameLayout) -> Iterator[RawFrame]:
    """Yield the frames of a stream without anything between them, each as soon as it has arrived.

    Raises InputError, after the last whole frame, when the stream ends within a frame, holds none,
    or cannot be read.

    Parameters
    ----------
    stream : RawIOBase
        Unbuffered; a buffered one would wait for more bytes than have arrived.

    Examples
    --------
    Standard input is ``open(sys.stdin.fileno(), "rb", buffering=0)``.

    >>> import io
    >>> from panchroma.device.capture import FrameLayout, read_frames
    >>> stream, layout = io.BytesIO(bytes(96)), FrameLayout(8, 4, "raw12")
    >>> [len(frame.data) for frame in read_frames(stream, layout)]
    [48, 48]
    """
    count = 0
    # Memory of frames that nobody needs any more: the system clears what is new to a process, which
    # takes as long as a copy.
    spare: deque[ByteArray] = deque(maxlen=_SPARE)
    while True:
        # Not a bytearray: clearing it would stop the other threads.
        memory = spare.pop() if spare else np.empty(layout.frame_bytes, np.uint8)
        lent = memory[:]  # kept by all that is made of the frame
        finalize(lent, spare.append, memory).atexit = False
        data, filled = lent.data, 0
        try:
            while filled < len(data) and (length := stream.readinto(data[filled:])):
                filled += length
        except OSError as error:
            why = f"({error.strerror or error}) after {count} whole frames"
            raise InputError(f"the stream cannot be read {why}") from None
        if filled < len(data):
            break
        count += 1
        yield RawFrame.now(data.toreadonly())
    if filled:
        wrong = "its frames have another size, and the shots of this stream are wrong"
        advice = f"If the camera was not stopped, {wrong}"
        if likely := layout.likely(count * len(data) + filled):
            discard = "discard the shots of this stream"
            advice = f"All its bytes are whole frames with {likely}: {discard}"
        place = f"{filled} bytes after {count} whole ones; {layout.size}. {advice}"
        raise FrameError(f"the stream ended in the middle of a frame, {place}")
    if not count:
        raise InputError("the stream ended before the first frame: did the camera start?")
