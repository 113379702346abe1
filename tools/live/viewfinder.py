"""The viewfinder's state: the latest picture for all viewers, figures about it, and the frame that a shot saves."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

import imagecodecs
import numpy as np

from device.capture import Saved
from device.capture.shots import ShotFolder
from shared import Mosaic
from shared.arrays import ByteArray
from shared.errors import InputError

_QUALITY = 80  # JPEG quality, 1 to 100: enough for a moving picture
_SPAN = 2.0  # seconds over which frames are counted


@dataclass(frozen=True, eq=False)
class View:
    """A picture of the viewfinder.

    picture: uint8 sRGB (h, w, 3).
    jpeg: the same as a JPEG file.
    number: counts the pictures, from 1.
    latency: seconds from the arrival of the frame until the picture was ready.
    mosaic: the frame that it shows.
    taken: when that was, with time zone.
    """

    picture: ByteArray
    jpeg: bytes
    number: int
    latency: float
    mosaic: Mosaic
    taken: datetime


class Viewfinder:
    """Passes pictures from one thread to any number of viewers' threads. Nobody waits for a slow viewer.

    dropped: returns the number of frames that came too fast to be shown.
    shots: the folder in which `shoot` saves; None = shots cannot be saved.
    """

    def __init__(self, dropped: Callable[[], int], shots: ShotFolder | None = None) -> None:
        self._dropped = dropped
        self._shots = shots
        self._changed = threading.Condition()
        self._view: View | None = None
        self._closed = False
        self._shown: deque[float] = deque()
        self._shooting = threading.Lock()

    @property
    def folder(self) -> Path | None:
        """Where `shoot` saves."""
        return self._shots.path if self._shots else None

    def show(self, picture: ByteArray, mosaic: Mosaic, taken: datetime, arrived: float) -> None:
        """Make a picture the latest view.

        picture: preview of the mosaic, uint8 sRGB (h, w, 3).
        mosaic: the frame that it shows; `shoot` saves it.
        taken, arrived: see `RawFrame`.
        """
        jpeg = _jpeg(picture)
        now = monotonic()
        with self._changed:
            number = self._view.number + 1 if self._view else 1
            self._view = View(picture, jpeg, number, now - arrived, mosaic, taken)
            self._shown.append(now)
            while self._shown[0] < now - _SPAN:
                self._shown.popleft()
            self._changed.notify_all()

    def after(self, number: int) -> View | None:
        """Wait for a view with a higher number than `number` and return it; None if the viewfinder is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or (self._view is not None and self._view.number > number))
            return None if self._closed else self._view

    def status(self) -> dict[str, Any]:
        """Return the figures for the page."""
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
        """Save the frame that is shown; its preview is the picture that is shown. Calls wait for each other.

        Raises InputError if there is no frame or no folder, OutputError if the file cannot be written.
        """
        if self._shots is None:
            raise InputError("no folder for shots: start with -o DIR")
        with self._shooting:
            view = self._view
            if view is None or self._closed:
                raise InputError("there is no frame: the camera has not begun, or has ended")
            started = perf_counter()
            path = self._shots.save(view.mosaic, view.picture, view.taken)
            return Saved(path, 0.0, perf_counter() - started)  # the preview was there already

    def close(self) -> None:
        """End all streams; returns after a shot in progress has been saved."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        with self._shooting:
            pass


def _jpeg(picture: ByteArray) -> bytes:
    return bytes(imagecodecs.jpeg8_encode(np.ascontiguousarray(picture), level=_QUALITY, subsampling="420"))
