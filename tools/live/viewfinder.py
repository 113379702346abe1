"""What a viewfinder shows: the latest picture for all who watch, figures about it, and the frame that a shot would save."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic, perf_counter
from typing import Any

import imagecodecs
import numpy as np

from device.capture import PreviewMaker, Saved
from device.frames import RawFrame
from device.shots import ShotFolder
from shared import Mosaic
from shared.arrays import ByteArray
from shared.errors import InputError

_QUALITY = 80  # of 100: for a moving picture
_SPAN = 2.0  # seconds over which frames are counted


@dataclass(frozen=True, eq=False)
class View:
    """A picture as a JPEG file, and what it is of. latency: seconds from the frame's arrival until it could be sent."""

    jpeg: bytes
    number: int
    latency: float
    frame: RawFrame
    mosaic: Mosaic


class Viewfinder:
    """One thread shows, others watch; none waits for a watcher that is slow.

    preview: of the picture that is shown. shots: where `shoot` saves, and the full preview for those; None = nowhere.
    dropped: asked for the frames that came too fast to be shown.
    """

    def __init__(
        self, preview: PreviewMaker, dropped: Callable[[], int], shots: tuple[ShotFolder, PreviewMaker] | None = None
    ) -> None:
        self._preview = preview
        self._dropped = dropped
        self._shots = shots
        self._changed = threading.Condition()
        self._view: View | None = None
        self._closed = False
        self._shown: deque[float] = deque()
        self._shooting = threading.Lock()

    def show(self, frame: RawFrame, mosaic: Mosaic) -> None:
        """Make the frame's picture the one that is shown."""
        jpeg = _jpeg(self._preview(mosaic))
        now = monotonic()
        with self._changed:
            number = self._view.number + 1 if self._view else 1
            self._view = View(jpeg, number, now - frame.arrived, frame, mosaic)
            self._shown.append(now)
            while self._shown[0] < now - _SPAN:
                self._shown.popleft()
            self._changed.notify_all()

    def after(self, number: int) -> View | None:
        """The latest view as soon as it is a later one than `number`; None when the viewfinder is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or (self._view is not None and self._view.number > number))
            return None if self._closed else self._view

    def status(self) -> dict[str, Any]:
        """Figures for the page."""
        with self._changed:
            view = self._view
            recent = [when for when in self._shown if when >= monotonic() - _SPAN]
        rows, columns = view.mosaic.shape if view else (0, 0)
        return {
            "frames": view.number if view else 0,
            "fps": (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 else 0.0,
            "latency_ms": 1e3 * view.latency if view else 0.0,
            "dropped": self._dropped(),
            "width": columns,
            "height": rows,
            "can_save": self._shots is not None,
        }

    def shoot(self) -> Saved:
        """Save the frame that is shown, with its full preview; one at a time.

        Raises InputError when there is none or no place for it, OutputError when it cannot be written.
        """
        if self._shots is None:
            raise InputError("no folder for shots: start with -o DIR")
        folder, preview = self._shots
        with self._shooting:
            view = self._view
            if view is None or self._closed:
                raise InputError("there is no frame: the camera has not begun, or has ended")
            started = perf_counter()
            picture = preview(view.mosaic)
            made = perf_counter()
            path = folder.save(view.mosaic, picture, view.frame.taken)
            return Saved(path, made - started, perf_counter() - made)

    def close(self) -> None:
        """Send the watchers home; returns when the shot in hand is finished."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        with self._shooting:
            pass


def _jpeg(picture: ByteArray) -> bytes:
    return bytes(imagecodecs.jpeg8_encode(np.ascontiguousarray(picture), level=_QUALITY, subsampling="420"))
