"""From raw frames to the viewfinder, with two frames in hand, so that a step that one core does alone leaves no core idle."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from pathlib import Path
from threading import Lock

from device.capture import PreviewMaker, Sensor
from device.capture.frame_queue import FrameQueue
from device.capture.frames import RawFrame
from device.capture.shots import ShotFolder
from device.capture.white_balance import SteadyWhite
from device.preview.geometry import Geometry
from shared import CfaPattern
from shared.errors import InputError

from .source import FrameSource, Refused, Stopped, preview_maker
from .viewfinder import Viewfinder

_WIDEST = 1440  # pixels: a wider picture does not fit a phone or a page, and costs the camera time
_IN_HAND = 2
_POLL = 0.1  # seconds


class LiveView:
    """The viewfinder of a source of frames: the attribute `finder`.

    source: where frames come from.
    folder: existing folder in which shots are saved; None = shots cannot be saved.
    latest: see `ShotFolder`.
    scale: sensor pixels per picture pixel, each way; None = such that the picture fits a page.
    threads: of the preview; None = one per core.
    Raises InputError and OutputError as `Preview` and `ShotFolder` do.
    """

    def __init__(
        self, source: FrameSource, folder: Path | None, latest: Path | None, *, scale: int | None, threads: int | None
    ) -> None:
        self._source, sensor = source, source.sensor
        shots = ShotFolder(folder, latest) if folder else None
        scale = fitting_scale(sensor.layout.width, sensor.pattern) if scale is None else scale
        self._preview = preview_maker(sensor, scale=scale, threads=threads)
        self._queue: FrameQueue | None = None
        self.finder = Viewfinder(lambda: sum(source.lost()) + (0 if self._queue is None else self._queue.dropped), shots)

    def show(self, stopped: Stopped, refused: Refused, note: Callable[[str], None]) -> None:
        """Show frames until they end; see `FrameSource.frames`. Raises InputError when the stream breaks off."""
        self._queue = FrameQueue(self._source.frames(stopped, refused, note), 1, stopped=stopped)
        show_frames(self._queue, self._source.sensor, self._preview, self.finder, refused)


def fitting_scale(width: int, pattern: CfaPattern) -> int:
    """The smallest scale of the pattern at which the picture is no wider than _WIDEST, or its largest scale."""
    scales = Geometry.scales(pattern)
    return next((scale for scale in scales if width <= _WIDEST * scale), scales[-1])


def show_frames(frames: Iterable[RawFrame], sensor: Sensor, preview: PreviewMaker, finder: Viewfinder, refused: Refused) -> None:
    """Show frames until they end, in their order.

    frames: for example a `FrameQueue`.
    sensor: the sensor they come from.
    preview: makes the picture that is shown.
    refused: called with the reason for each frame that does not fit the sensor.
    Raises the error that ends `frames`.
    """
    source, balance = iter(frames), SteadyWhite()
    balancing, previewing, encoding = Lock(), Lock(), Lock()  # the preview is made on all cores, the others on one

    def show_next() -> bool:
        with ExitStack() as held:
            held.enter_context(balancing)
            frame = next(source, None)
            if frame is None:
                return False
            try:
                mosaic = balance(sensor.mosaic(frame))
                taken, arrived = frame.taken, frame.arrived
                del frame  # its bytes; only the mosaic is needed now
                _go_on(held, previewing)
                picture = preview(mosaic)
                _go_on(held, encoding)
                finder.show(picture, mosaic, taken, arrived)
            except InputError as error:
                refused(error)
        return True

    def work() -> None:
        while show_next():
            pass

    with ThreadPoolExecutor(_IN_HAND, "show") as pool:
        working = [pool.submit(work) for _ in range(_IN_HAND)]
        # Not without end: a signal that another thread gets is handled when the main thread wakes.
        while wait(working, _POLL).not_done:
            pass
        for each in working:
            each.result()  # raises the error


def _go_on(held: ExitStack, step: Lock) -> None:
    """Take this step's lock before the last one's is let go, so that no frame overtakes another."""
    with held.pop_all():
        held.enter_context(step)
