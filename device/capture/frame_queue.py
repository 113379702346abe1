"""A queue between a sensor, which does not wait, and a slower consumer: surplus frames are dropped and counted."""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator

from .frames import RawFrame

_POLL = 0.1  # seconds between two calls of `stopped`


class FrameQueue:
    """Reads `frames` in a background thread; iterate over the queue to receive them.

    frames: the source.
    depth: number of frames that may wait. When one more arrives, the oldest is dropped whole: pictures stay close to the present,
        and memory holds at most `depth` + 2 frames (one arriving, one in use).
    wait: let the source wait instead of dropping frames; for a recording.
    stopped: returns True to end before the next frame; polled every 0.1 s.
    The attribute `dropped` counts the frames lost so far. Iterating raises the error that reading the source raised, after all
    frames that arrived before it.
    """

    def __init__(
        self, frames: Iterable[RawFrame], depth: int, *, wait: bool = False, stopped: Callable[[], bool] = lambda: False
    ) -> None:
        self.dropped = 0
        self._waiting: deque[RawFrame] = deque()
        self._depth, self._wait, self._stopped = depth, wait, stopped
        self._ended = False
        self._failure: BaseException | None = None
        self._changed = threading.Condition()
        # A daemon, because a blocking read from a silent camera cannot be cancelled.
        threading.Thread(target=self._fill, args=(frames,), name="frames", daemon=True).start()

    def __iter__(self) -> Iterator[RawFrame]:
        while (frame := self._take()) is not None:
            yield frame
        if self._failure is not None and not self._stopped():
            raise self._failure

    def __len__(self) -> int:
        """Number of frames that wait."""
        return len(self._waiting)

    def _take(self) -> RawFrame | None:
        with self._changed:
            while not (self._waiting or self._ended or self._stopped()):
                self._changed.wait(_POLL)
            self._changed.notify_all()
            return self._waiting.popleft() if self._waiting and not self._stopped() else None

    def _fill(self, frames: Iterable[RawFrame]) -> None:
        try:
            for frame in frames:
                with self._changed:
                    while self._wait and len(self._waiting) >= self._depth and not self._stopped():
                        self._changed.wait(_POLL)
                    if self._stopped():
                        return
                    if len(self._waiting) >= self._depth:
                        self._waiting.popleft()
                        self.dropped += 1
                    self._waiting.append(frame)
                    self._changed.notify_all()
        except Exception as failure:
            self._failure = failure
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()
