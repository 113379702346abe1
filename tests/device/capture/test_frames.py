import io
import re
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from panchroma.device.capture.frame_queue import FrameQueue
from panchroma.device.capture.frames import (
    FORMATS,
    FrameLayout,
    RawFrame,
    format_named,
    read_frames,
)
from panchroma.shared.errors import InputError
from tests.device.packer import pack, random_codes

# --- frames ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 6, 7, 8, 9, 37])
@pytest.mark.parametrize("extra", [0, 1, 27])
def test_what_is_packed_bit_by_bit_is_unpacked(name: str, width: int, extra: int) -> None:
    """Every width, groups that end within a line, and padding that is not zero."""
    # more rows than one strip, and not a whole number of them
    codes = random_codes((35, width), FORMATS[name].bits, seed=width)
    layout = FrameLayout(width, 35, name)
    layout = FrameLayout(width, 35, name, layout.line_bytes + extra)
    data = pack(codes, name, layout.stride)
    assert len(data) == layout.frame_bytes
    for kind in (bytes, bytearray, memoryview):
        unpacked = layout.unpack(kind(data))
        assert unpacked.dtype == np.uint16
        assert np.array_equal(unpacked, codes)


@pytest.mark.parametrize(
    ("name", "data", "codes"),
    [
        # V4L2: SRGGB10P, SRGGB12P and SRGGB16; the first pixel's lower bits are the lowest of the
        # last byte.
        ("raw10", (255, 0, 1, 128, 0b11_10_01_00), (0b1111111100, 0b01, 0b110, 0b1000000011)),
        ("raw12", (0b11111111, 0b00000001, 0b1000_0111), (0b111111110111, 0b11000)),
        ("u16", (0x34, 0x12, 0xFF, 0x00), (0x1234, 0xFF)),
        ("u16be", (0x12, 0x34, 0x00, 0xFF), (0x1234, 0xFF)),
        # Machine vision: PFNC has the lowest bits first, GigE Vision the highest.
        ("mono12p", (0xBC, 0x3A, 0x12), (0xABC, 0x123)),
        ("mono12packed", (0xAB, 0x3C, 0x12), (0xABC, 0x123)),
        ("mono10packed", (0b10101010, 0b0001_0011, 0b01000000), (0x2AB, 0x101)),
        ("mono10p", (0xAB, 0b000001_10, 0b0100, 0, 0), (0x2AB, 0x101)),
    ],
)
def test_tables_written_by_hand(name: str, data: tuple[int, ...], codes: tuple[int, ...]) -> None:
    assert FrameLayout(len(codes), 1, name).unpack(bytes(data)).tolist() == [[*codes]]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ((0, 4, "raw10"), "width is 0"),
        ((4, -1, "raw10"), "height is -1"),
        ((70000, 4, "raw10"), "width is 70000 pixels, expected 1 to 65500"),
        ((4, 4, "raw16"), "'raw16' is unknown; one of raw10, raw12, raw14"),
        ((8, 4, "raw10", 9), "stride is 9 bytes, but a line of 8 pixels in raw10 has 10"),
        ((8, 4, "u16", -16), "stride is -16"),
    ],
)
def test_a_layout_that_no_frame_has(fields: tuple[int, int, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        FrameLayout(*fields)


@pytest.mark.parametrize(
    ("length", "words"),
    [
        (0, "0 bytes are not a frame: 8 x 4 pixels in raw10 with a stride of 10 have 40$"),
        (39, "39 bytes are not a frame.*have 40$"),
        (128, "have 40; a stride of 32 would fit$"),
        (120, "have 40; 3 frames in one are a stream: give it on standard input$"),
        (20, "have 40$"),  # a stride of 5 is too short
    ],
)
def test_a_frame_of_another_size_is_explained(length: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        FrameLayout(8, 4, "raw10").unpack(bytes(length))


@pytest.mark.parametrize(
    ("names", "meant"),
    [
        ("raw10 SBGGR10_CSI2P SRGGB10P pgAA", ("raw10", 10)),
        ("SRGGB12_CSI2P", ("raw12", 12)),
        ("Y14P SGRBG14_CSI2P pREE", ("raw14", 14)),
        ("GREY R8 BA81 Mono8 SCF1WBWG8", ("u8", 8)),
        ("SCF1WGWB10", ("u16", 10)),
        ("SRGGB12 R12 Mono12", ("u16", 12)),
        ("Y14 SCF1WBWG14", ("u16", 14)),
        ("SGBRG16 SCF1WBWG16", ("u16", 16)),
        ("Y16_BE", ("u16be", 16)),
        ("Mono10p SCF1WGWR10p", ("mono10p", 10)),
        ("Mono12p SCF1WRWG12p", ("mono12p", 12)),
        ("Mono10Packed", ("mono10packed", 10)),
        ("Mono12Packed", ("mono12packed", 12)),
    ],
)
def test_the_names_of_v4l2_libcamera_and_pfnc(names: str, meant: tuple[str, int]) -> None:
    assert {format_named(name) for name in names.split()} == {meant}


UNKNOWN = "unknown; one of raw10, raw12, raw14, mono10p"


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (UNKNOWN, ["", "RAW10", "SRGGB9", "SCF1BWGW8", "Mono12pmsb", "XSRGGB10P", "SRGGB10P\n"]),
        ("PISP_COMP1 is a lossy compression.*--mode W:H:12:U", ["BGGR_PISP_COMP1"]),
    ],
)
def test_other_formats_are_refused(words: str, names: list[str]) -> None:
    for name in names:
        with pytest.raises(InputError, match=words):
            format_named(name)


LAYOUT = FrameLayout(5, 3, "raw10", 12)


class ShortReads(io.RawIOBase):
    """A pipe that gives a few bytes at a time."""

    def __init__(self, data: bytes, length: int, failure: OSError | None = None) -> None:
        self._stream, self._length, self._failure = io.BytesIO(data), length, failure

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        length = self._stream.readinto(buffer[: self._length])
        if not length and self._failure:
            raise self._failure
        return length


def frames(count: int) -> list[bytes]:
    return [pack(random_codes((3, 5), 10, seed), "raw10", 12) for seed in range(count)]


@pytest.mark.parametrize("length", [1, 7, 36, 50, 1000])
def test_a_stream_is_cut_into_its_frames(length: int) -> None:
    sent = frames(4)
    read = list(read_frames(ShortReads(b"".join(sent), length), LAYOUT))
    assert [bytes(frame.data) for frame in read] == sent
    assert [frame.arrived for frame in read] == sorted(frame.arrived for frame in read)
    assert all(frame.taken.utcoffset() is not None for frame in read)


def test_words_are_not_copied_where_nobody_can_change_them() -> None:
    layout = FrameLayout(5, 3, "u16", 12)
    data = np.arange(36, dtype=np.uint8)
    assert np.shares_memory(layout.unpack(data.data.toreadonly()), data)
    assert not np.shares_memory(layout.unpack(data.data), data)
    assert not np.shares_memory(FrameLayout(5, 3, "u16be", 12).unpack(data.data.toreadonly()), data)


def test_only_the_memory_of_frames_that_nobody_needs_is_used_again() -> None:
    layout, sent = FrameLayout(5, 3, "u16", 12), [bytes([number] * 36) for number in range(8)]
    kept, places = [], []
    for number, frame in enumerate(read_frames(ShortReads(b"".join(sent), 50), layout)):
        codes = layout.unpack(frame.data)
        places.append(codes.ctypes.data)
        if number % 2:
            kept.append(codes)
        del frame, codes
    assert [np.unique(codes).tolist() for codes in kept] == [[257], [3 * 257], [5 * 257], [7 * 257]]
    assert len(set(places)) < len(places)


SENT = b"".join(frames(3))
SIZE = "5 x 3 pixels in raw10 with a stride of 12 have 36"


@pytest.mark.parametrize(
    ("data", "failure", "whole", "words"),
    [
        (SENT[:73], None, 2, f"1 bytes after 2 whole ones; {SIZE}"),
        (SENT[:107], None, 2, f"35 bytes after 2 whole ones; {SIZE}"),
        (bytes(192), None, 5, "whole frames with `stride=16`: discard the shots of this stream"),
        (bytes(193), None, 5, "have another size, and the shots of this stream are wrong"),
        (b"", None, 0, "ended before the first frame"),
        (SENT, OSError(5, "Input/output error"), 3, "be read (Input/output error) after 3 whole"),
    ],
)
def test_a_stream_that_ends_badly_says_so_after_the_whole_frames(
    data: bytes, failure: OSError | None, whole: int, words: str
) -> None:
    read: list[RawFrame] = []
    with pytest.raises(InputError, match=re.escape(words)):
        # keeps what came before
        read.extend(read_frames(ShortReads(data, 10, failure), LAYOUT))
    assert b"".join(frame.data for frame in read) == data[: 36 * whole]


# --- frame queue ----------------------------------------------------------------------------------


def frame(number: int) -> RawFrame:
    return RawFrame.now(bytes([number]))


def numbers(queue: FrameQueue) -> list[int]:
    return [each.data[0] for each in queue]


def until(condition: Callable[[], bool]) -> None:
    """Wait for another thread; a minute stands for never."""
    waiting = threading.Event()
    for _ in range(6000):
        if condition():
            return
        waiting.wait(0.01)
    raise AssertionError("waited in vain")


def test_a_queue_without_an_end_is_refused() -> None:
    with pytest.raises(InputError, match="`depth` is 0, expected 1 or more"):
        FrameQueue([], 0)


def test_the_oldest_is_dropped_when_nobody_takes_them() -> None:
    sent = threading.Event()

    def source() -> Iterator[RawFrame]:
        yield from map(frame, range(10))
        sent.set()

    queue = FrameQueue(source(), 2)
    assert sent.wait(60)
    assert queue.dropped == 8
    assert len(queue) == 2
    assert numbers(queue) == [8, 9]


def test_a_recording_waits() -> None:
    given: list[int] = []

    def source() -> Iterator[RawFrame]:
        for number in range(20):
            given.append(number)
            yield frame(number)

    queue = FrameQueue(source(), 2, wait=True)
    until(lambda: len(given) == 3)  # two wait, one has no place
    assert numbers(queue) == list(range(20))
    assert queue.dropped == 0


def test_stopping_releases_a_source_that_waits() -> None:
    stop = False
    before = threading.active_count()
    queue = FrameQueue(map(frame, range(10)), 1, wait=True, stopped=lambda: stop)
    until(lambda: len(queue) == 1)
    stop = True
    until(lambda: threading.active_count() == before)
    assert numbers(queue) == []
