"""From raw frames to the viewfinder, with two frames in hand, so that a step that one core does alone leaves no core idle."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from threading import Lock
from types import TracebackType

from device.capture import PreviewMaker, Sensor
from device.capture.frames import RawFrame
from device.capture.white_balance import SteadyWhite
from shared.errors import InputError

from .viewfinder import Viewfinder

_IN_HAND = 2
_POLL = 0.1  # seconds
_STEPS = 3  # unpacking and balancing; the preview, on all cores; the JPEG


def show_frames(
    frames: Iterable[RawFrame], sensor: Sensor, preview: PreviewMaker, finder: Viewfinder, refused: Callable[[InputError], None]
) -> None:
    """Show frames until they end, in their order.

    frames: for example a `FrameQueue`.
    sensor: the sensor they come from.
    preview: makes the picture that is shown.
    refused: called with the reason for each frame that does not fit the sensor.
    Raises the error that ends `frames`.
    """
    source, balance = iter(frames), SteadyWhite()
    steps = tuple(Lock() for _ in range(_STEPS))

    def work() -> None:
        while _show_next(source, steps, sensor, balance, preview, finder, refused):
            pass

    with ThreadPoolExecutor(_IN_HAND, "show") as pool:
        working = [pool.submit(work) for _ in range(_IN_HAND)]
        # Not without end: a signal that another thread gets is handled when the main thread wakes.
        while wait(working, _POLL).not_done:
            pass
        for each in working:
            each.result()  # raises the error


def _show_next(
    source: Iterator[RawFrame],
    steps: tuple[Lock, ...],
    sensor: Sensor,
    balance: SteadyWhite,
    preview: PreviewMaker,
    finder: Viewfinder,
    refused: Callable[[InputError], None],
) -> bool:
    """Show the next frame. Returns whether there was one."""
    with _Turn(steps) as turn:
        frame = next(source, None)
        if frame is None:
            return False
        try:
            mosaic = balance(sensor.mosaic(frame))
            taken, arrived = frame.taken, frame.arrived
            del frame  # its bytes; only the mosaic is needed now
            turn.next()
            picture = preview(mosaic)
            turn.next()
            finder.show(picture, mosaic, taken, arrived)
        except InputError as error:
            refused(error)
    return True


class _Turn:
    """Holds one step's lock after the other. The next is taken before the last is let go, so that no frame overtakes another."""

    def __init__(self, steps: tuple[Lock, ...]) -> None:
        self._steps = steps
        self._at = 0

    def next(self) -> None:
        """Go on to the next step."""
        self._steps[self._at + 1].acquire()
        self._steps[self._at].release()
        self._at += 1

    def __enter__(self) -> "_Turn":
        self._steps[0].acquire()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._steps[self._at].release()
