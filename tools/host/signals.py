"""What the signals that end a program do: an orderly exit, and for commands that run until they are told to stop, a good end."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType

INTERRUPTED = 130
_ENDING = (signal.SIGTERM, signal.SIGHUP)


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP has come: all that an interruption leaves in order, this does too."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


@contextmanager
def orderly_end() -> Iterator[None]:
    """In the `with` block SIGTERM and SIGHUP raise Terminated; by default they would leave temporary files behind.

    Where somebody has decided otherwise (nohup), and in another thread than the first, nothing is changed.
    """
    free = [number for number in _ENDING if signal.getsignal(number) == signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        free = []
    for number in free:
        signal.signal(number, _terminate)
    try:
        yield
    finally:
        for number in free:
            signal.signal(number, signal.SIG_DFL)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated(number)


class Stopping:
    """Calling it says whether one of the two signals has come since the `with` block began. A second one acts as ever."""

    def __init__(self) -> None:
        self._signal = 0
        self._before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def __call__(self) -> bool:
        """Whether to stop."""
        return bool(self._signal)

    @property
    def code(self) -> int:
        """Exit code: 130 when interrupted; 0 otherwise, because SIGTERM is how a service is told that it has done its work."""
        return INTERRUPTED if self._signal == signal.SIGINT else 0

    def __enter__(self) -> "Stopping":
        for number in self._before:
            signal.signal(number, self._stop)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._restore()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        # Nothing but this: a lock could be held by the very code that the signal interrupts.
        self._signal = number
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
