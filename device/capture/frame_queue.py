"""A queue between a sensor, which does not wait, and a slower consumer: surplus frames are dropped
and counted.
"""

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress

from ...shared.errors import InputError
from .frames import RawFrame

_POLL_QUEUE = 0.1  # seconds between two calls of `stopped`, and from the last frame to the end


class FrameQueue:
    """Reads `frames` in a background thread; iterate over the queue to receive them.

    The attribute `dropped` counts the frames lost so far. Iterating raises the error that reading
    the source raised, after all frames that arrived before it.

    Parameters
    ----------
    frames : Iterable[RawFrame]
        The source.
    depth : int
        Number of frames that may wait, 1 or more. When one more arrives, the oldest is dropped
        whole: pictures stay close to the present, and memory holds at most `depth` + 2 frames (one
        arriving, one in use).
    wait : bool, optional
        Let the source wait instead of dropping frames; for a recording.
    stopped : Callable[[], bool], optional
        Returns True to end before the next frame; polled every 0.1 s.

    Raises
    ------
    InputError
        For a depth below 1, with which no frame would ever be dropped.

    Examples
    --------
    >>> import io
    >>> from panchroma.device.capture import FrameLayout, FrameQueue, read_frames
    >>> frames = read_frames(io.BytesIO(bytes(96)), FrameLayout(8, 4, "raw12"))
    >>> len(list(FrameQueue(frames, depth=2)))
    2
    """

    def __init__(
        self,
        frames: Iterable[RawFrame],
        depth: int,
        *,
        wait: bool = False,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        if depth < 1:
            raise InputError(f"`depth` is {depth}, expected 1 or more")
        self.dropped = 0
        self._frames: queue.Queue[RawFrame] = queue.Queue(depth)
        self._wait, self._stopped = wait, stopped
        self._has_ended = threading.Event()
        self._failure: Exception | None = None
        # A daemon, because a blocking read from a silent camera cannot be cancelled.
        threading.Thread(target=self._fill, args=(frames,), name="frames", daemon=True).start()

    def __iter__(self) -> Iterator[RawFrame]:
        while not self._stopped():
            # asked first: then no frame comes after the queue is found empty
            has_ended = self._has_ended.is_set()
            try:
                yield self._frames.get(timeout=0 if has_ended else _POLL_QUEUE)
            except queue.Empty:
                if not has_ended:
                    continue
                if self._failure is not None and not self._stopped():
                    raise self._failure from None
                return

    def __len__(self) -> int:
        """Number of frames that wait."""
        return self._frames.qsize()

    def _fill(self, frames: Iterable[RawFrame]) -> None:
        try:
            for frame in frames:
                while not self._stopped():
                    try:
                        self._frames.put(frame, self._wait, _POLL_QUEUE)
                        break
                    except queue.Full:
                        if not self._wait:
                            with suppress(queue.Empty):  # it may have been taken meanwhile
                                self._frames.get_nowait()
                                self.dropped += 1
                else:
                    return
        except Exception as failure:
            self._failure = failure
        finally:
            self._has_ended.set()
