"""The viewfinder: from raw frames to the latest picture for all viewers, figures about it, and the
frame that a shot saves.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

import imagecodecs
import numpy as np

from ...device.capture import PreviewMaker, Saved, Sensor
from ...device.capture.frames import RawFrame
from ...device.capture.loop import SteadyWhite
from ...device.capture.shots import ShotFolder
from ...device.preview.geometry import Geometry
from ...shared import ByteArray, CfaPattern, InputError, Mosaic
from .frame_source import Refused

_SPAN, _MISSED = 2.0, 2.5  # seconds, and intervals, without a picture: the camera counts as silent
_WIDEST = 1440  # pixels: a wider picture does not fit a phone or a page, and costs the camera time


@dataclass(frozen=True, eq=False)
class View:
    """A picture of the viewfinder.

    Attributes
    ----------
    picture : ByteArray
        uint8 sRGB (h, w, 3).
    jpeg : bytes
        The same as a JPEG file.
    number : int
        Counts the pictures, from 1.
    latency : float
        Seconds from the arrival of the frame until the picture was ready.
    clipped : float
        Part of its samples at the white level, 0 to 1.
    mosaic : Mosaic
        The frame that it shows.
    taken, is_checked : datetime, bool
        See `RawFrame`.
    """

    picture: ByteArray
    jpeg: bytes
    number: int
    latency: float
    clipped: float
    mosaic: Mosaic
    taken: datetime
    is_checked: bool


class Viewfinder:
    """Passes pictures from one thread to any number of viewers' threads. Nobody waits for a slow
    viewer.

    The attribute `doubtful` is the first of the shots that may be wrong if a frame is not as
    described, see `doubts`, `folder` is where `shoot` saves, `closed` says that there are no more
    pictures.

    dropped: returns the number of frames that came too fast to be shown. shots: the folder in which
    `shoot` saves; None = shots cannot be saved.
    """

    def __init__(self, dropped: Callable[[], int], shots: ShotFolder | None = None) -> None:
        self._dropped, self._shots = dropped, shots
        self.folder = shots.path if shots else None
        self._changed, self._shooting = threading.Condition(), threading.Lock()
        self._view: View | None = None
        self.closed, self._begun = False, monotonic()
        self._shown: deque[float] = deque(maxlen=20)  # times of the last pictures
        self.doubtful: Path | None = None

    def show(self, picture: ByteArray, mosaic: Mosaic, frame: RawFrame) -> None:
        """Make a picture the latest view.

        Parameters
        ----------
        picture : ByteArray
            Preview of the mosaic, uint8 sRGB (h, w, 3).
        mosaic : Mosaic
            The samples of the frame; `shoot` saves them.
        frame : RawFrame
            The frame that it shows.
        """
        options: Any = {"level": 80, "subsampling": "420"}  # quality enough for a moving picture
        jpeg = bytes(imagecodecs.jpeg8_encode(np.ascontiguousarray(picture), **options))
        # Some rows show how much is clipped; no period has this divisor.
        clipped = float((mosaic.codes[::17] >= mosaic.calibration.white_level).mean())
        now = monotonic()
        with self._changed:
            number = self._view.number + 1 if self._view else 1
            latency, facts = now - frame.arrived, (frame.taken, frame.is_checked)
            self._view = View(picture, jpeg, number, latency, clipped, mosaic, *facts)
            if frame.is_checked:
                self.doubtful = None
            self._shown.append(now)
            self._changed.notify_all()

    def show_frames(
        self, frames: Iterable[RawFrame], sensor: Sensor, preview: PreviewMaker, refused: Refused
    ) -> None:
        """Show frames until they end, in their order.

        Raises the error that ends `frames`.

        Parameters
        ----------
        frames : Iterable[RawFrame]
            For example a `FrameQueue`.
        sensor : Sensor
            The sensor they come from.
        preview : PreviewMaker
            Makes the picture that is shown.
        refused : Refused
            Called with the reason for each frame that does not fit the sensor.
        """
        balance, job = SteadyWhite(), None
        # encodes, on one core, while the next preview is made
        with ThreadPoolExecutor(1, "show") as pool:
            for frame in frames:
                try:
                    mosaic = balance(sensor.mosaic(frame))
                    picture = preview(mosaic)
                except InputError as error:
                    refused(error)
                    continue
                if job is not None:
                    job.result()
                job = pool.submit(self.show, picture, mosaic, frame)
            if job is not None:
                job.result()

    def after(self, number: int, seconds: float | None = None) -> View | None:
        """Wait for a view with a higher number than `number` and return it; None if none comes, or
        if the viewfinder is closed.

        seconds: to wait at most; None = without end.
        """

        def is_newer() -> bool:
            return self._view is not None and self._view.number > number

        with self._changed:
            self._changed.wait_for(lambda: self.closed or is_newer(), seconds)
            return self._view if is_newer() and not self.closed else None

    def status(self) -> dict[str, Any]:
        """Return the figures for the page."""
        with self._changed:
            view, times = self._view, [*self._shown]
        rows, columns = view.mosaic.shape if view else (0, 0)
        # Judged by the camera's own interval: exposures may be longer than any fixed span, and so
        # is the wait for the first one.
        intervals = np.diff(times if len(times) > 1 else [self._begun, *times])
        silent = not times or monotonic() - times[-1] > max(_SPAN, _MISSED * intervals.max())
        known = not silent and len(times) > 1
        return {
            "frames": view.number if view else 0,
            "silent": bool(silent),
            "fps": 1 / float(intervals.mean()) if known else 0.0,
            "latency_ms": 1e3 * view.latency if view else 0.0,
            "dropped": self._dropped(),
            "clipped": view.clipped if view else 0.0,
            "width": columns,
            "height": rows,
            "can_save": self._shots is not None,
        }

    def shoot(self) -> Saved:
        """Save the frame that is shown; its preview is the picture that is shown. Calls wait for
        each other.

        Raises InputError if there is no frame or no folder. Raises OutputError if the file cannot
        be written.
        """
        if self._shots is None:
            raise InputError("no folder for shots: start with -o DIR")
        with self._shooting:
            view = self._view
            if view is None or self.closed:
                raise InputError("there is no frame: the camera has not begun, or has ended")
            started = perf_counter()
            path = self._shots.save(view.mosaic, view.picture, view.taken)
            # the preview was there already
            shot = Saved(path, 0.0, perf_counter() - started, view.is_checked)
            if shot.is_checked or not self.doubtful:
                self.doubtful = path
            return shot

    def close(self) -> None:
        """End all streams; returns after a shot in progress has been saved."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()
        with self._shooting:
            pass


def fitting_scale(width: int, pattern: CfaPattern) -> int:
    """The smallest scale of the pattern at which the picture is no wider than _WIDEST, or its
    largest scale.
    """
    scales = Geometry.scales(pattern)
    return next((scale for scale in scales if width <= _WIDEST * scale), scales[-1])
