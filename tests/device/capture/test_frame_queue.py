import threading
from collections.abc import Callable, Iterator

import pytest

from panchroma.device.capture.frame_queue import FrameQueue
from panchroma.device.capture.frames import RawFrame
from panchroma.shared.errors import InputError


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


@pytest.mark.parametrize("depth", [0, -1])
def test_a_queue_without_an_end_is_refused(depth: int) -> None:
    with pytest.raises(InputError, match=f"`depth` is {depth}, expected 1 or more"):
        FrameQueue([frame(0)], depth)


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


def test_what_breaks_the_source_comes_after_its_frames() -> None:
    def source() -> Iterator[RawFrame]:
        yield frame(1)
        yield frame(2)
        raise InputError("cut in the middle")

    received = iter(FrameQueue(source(), 2))
    assert [next(received).data[0], next(received).data[0]] == [1, 2]
    with pytest.raises(InputError, match="cut in the middle"):
        next(received)


def test_stopping_ends_it_while_the_source_is_silent() -> None:
    silent = threading.Event()

    def source() -> Iterator[RawFrame]:
        yield frame(1)
        silent.wait()

    stop = False
    queue = FrameQueue(source(), 2, stopped=lambda: stop)
    got = []
    for each in queue:
        got.append(each.data[0])
        stop = True
    assert got == [1]
    silent.set()


def test_stopping_releases_a_source_that_waits() -> None:
    stop = False
    before = threading.active_count()
    queue = FrameQueue(map(frame, range(10)), 1, wait=True, stopped=lambda: stop)
    until(lambda: len(queue) == 1)
    stop = True
    until(lambda: threading.active_count() == before)
    assert numbers(queue) == []
