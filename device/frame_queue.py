"""Frames from a sensor that does not wait to a consumer that may be slower: few are kept, the rest are dropped and counted."""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator

from .frames import RawFrame

_POLL = 0.1  # seconds between two looks at whether to stop


class FrameQueue:
    """Reads `frames` in a thread of its own; iterating gives them to the thread that does.

    depth: frames that may wait. When one more comes, the oldest is dropped whole: what is shown and saved stays close to the
        present, and memory holds `depth` + 2 frames (one arriving, one in hand), however long it runs.
    wait: never drop, let the source wait instead: for a recording.
    stopped: says whether to end before the next frame; asked every 0.1 s.
    dropped: whole frames lost so far.
    Iterating raises what reading the source raised, after the frames that came before it.
    """

    def __init__(
        self, frames: Iterable[RawFrame], depth: int, *, wait: bool = False, stopped: Callable[[], bool] = lambda: False
    ) -> None:
        self.dropped = 0
        self._waiting: deque[RawFrame] = deque()
        self._depth = depth
        self._wait = wait
        self._stopped = stopped
        self._ended = False
        self._failure: BaseException | None = None
        self._changed = threading.Condition()
        # A daemon, because a read of a silent camera cannot be called off.
        self._reader = threading.Thread(target=self._fill, args=(frames,), name="frames", daemon=True)
        self._reader.start()

    def __iter__(self) -> Iterator[RawFrame]:
        while (frame := self._take()) is not None:
            yield frame
        if self._failure is not None and not self._stopped():
            raise self._failure

    def __len__(self) -> int:
        """Frames that wait."""
        return len(self._waiting)

    def _take(self) -> RawFrame | None:
        with self._changed:
            while not self._stopped():
                if self._waiting:
                    frame = self._waiting.popleft()
                    self._changed.notify_all()
                    return frame
                if self._ended:
                    break
                self._changed.wait(_POLL)
            return None

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
