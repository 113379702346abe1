"""From the frames of a source to shots in a folder, with the camera's preview in each."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from ...device.capture import Saved, capture, capture_burst
from ...device.capture.frame_queue import FrameQueue
from ...device.capture.shots import ShotFolder
from .source import FrameSource, Note, Stopped, preview_maker

# frames that may wait: one covers a slow write, a second a pause of the disk; more would only be
# older
_DEPTH = 2


class Recorder:
    """Saves frames as shots.

    Raises InputError and OutputError as `ShotFolder` does.

    Parameters
    ----------
    source : FrameSource
        Where they come from.
    folder : Path
        An existing folder.
    latest : Path | None
        See `ShotFolder`.
    burst : int | None
        Number of frames that are taken as fast as they come, and saved under one name; None = each
        on its own.
    """

    def __init__(
        self, source: FrameSource, folder: Path, latest: Path | None, *, burst: int | None
    ) -> None:
        self._source, self._burst = source, burst
        self._shots = ShotFolder(folder, latest)
        self._preview = preview_maker(source.sensor)
        self._queue: FrameQueue | None = None

    @property
    def dropped(self) -> int:
        """Number of frames that came too fast to be saved, or arrived incomplete."""
        # an empty queue counts as false
        return sum(self._source.lost()) + (0 if self._queue is None else self._queue.dropped)

    @property
    def waiting(self) -> int:
        """Number of frames that have come and are not saved yet; of a burst, only those that nobody
        has taken.
        """
        return 0 if self._queue is None else len(self._queue)

    def saved(
        self, stopped: Stopped, refused: Callable[[object], None], note: Note
    ) -> Iterator[Saved]:
        """Save frames until they end, and yield each.

        Parameters
        ----------
        stopped : Stopped
            Polled between frames: whether to end.
        refused : Callable[[object], None]
            Called with the reason for each frame that is not saved.
        note : Note
            Called with remarks on the first frames.

        Raises
        ------
        InputError
            When the stream breaks off.
        OutputError
            When a file cannot be written.
        """
        frames, burst = self._source.frames(stopped, refused, note), self._burst
        if burst:  # all frames may wait: none is dropped, and no more are read
            frames = islice(frames, burst)
        self._queue = queue = FrameQueue(
            frames, burst or _DEPTH, wait=self._source.waits, stopped=stopped
        )
        to = self._source.sensor, self._preview, self._shots
        for outcome in capture_burst(queue, burst, *to) if burst else capture(queue, *to):
            if isinstance(outcome, Saved):
                yield outcome
            elif not (burst and stopped()):  # then the user has ended it
                refused(outcome.reason)
