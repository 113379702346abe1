"""Signals that end a program: commands clean up, services finish their current work."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_DEFAULT = (signal.SIG_DFL, signal.default_int_handler)
# raised since `orderly_end` began, even if something has caught it
_received: list["Terminated"] = []


class Terminated(KeyboardInterrupt):
    """SIGINT, SIGTERM or SIGHUP was received. A KeyboardInterrupt: what cleans up after an
    interrupt does so after each of them.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


@contextmanager
def orderly_end(*, last: bool = False) -> Iterator[None]:
    """In the `with` block SIGINT, SIGTERM and SIGHUP raise Terminated; by default the last two
    would leave temporary files behind.

    A signal that is ignored or handled already (nohup) is left as it is, and so are all outside the
    main thread.

    last: the program ends after the block: from then on they end it at once, without a traceback.
    """
    numbers = ENDING if threading.current_thread() is threading.main_thread() else ()
    free = [number for number in numbers if signal.getsignal(number) in _DEFAULT]
    _received.clear()
    before = {number: signal.signal(number, _terminate) for number in free}
    try:
        yield
    except Exception:
        raise_lost_signal()
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if last else handler)


def _terminate(number: int, _: FrameType | None) -> None:
    _received.append(Terminated(number))
    raise _received[-1]


def raise_lost_signal() -> None:
    """Raise Terminated again if a signal was received: a C extension that is being imported turns
    it into an ImportError, and a callback from C drops it: then the next file is not begun.
    """
    if _received:
        raise _received[-1]


class Stopping:
    """Says, when called, whether SIGINT or SIGTERM was received in the `with` block. A second
    signal has its usual effect.
    """

    _signal = 0

    def __call__(self) -> bool:
        """True if the command has to stop."""
        return bool(self._signal)

    @property
    def code(self) -> int:
        """Exit code: 130 when interrupted, otherwise 0, because SIGTERM is the normal way to stop a
        service.
        """
        return INTERRUPTED if self._signal == signal.SIGINT else 0

    def __enter__(self) -> "Stopping":
        numbers = signal.SIGINT, signal.SIGTERM
        self._before = {number: signal.signal(number, self._stop) for number in numbers}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        # Do no more than this here: the code that the signal interrupts may hold a lock.
        self._signal = number
        self.__exit__()
