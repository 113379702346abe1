"""SIGINT and SIGTERM for commands that run until they are told to stop: what is in hand gets finished."""

import signal
from types import FrameType, TracebackType

from .cli import INTERRUPTED


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
