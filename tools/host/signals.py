"""Signals that end a program: commands clean up, services finish their current work, workers end with their parent."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import wait
from types import FrameType, TracebackType

INTERRUPTED = 130
_ENDING = (signal.SIGTERM, signal.SIGHUP)
_received: list["Terminated"] = []  # raised since `orderly_end` began, even if something has caught it


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP was received. A KeyboardInterrupt, so that all that cleans up after an interrupt does so here too."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


@contextmanager
def orderly_end() -> Iterator[None]:
    """In the `with` block SIGTERM and SIGHUP raise Terminated; by default they would leave temporary files behind.

    A signal that is ignored or handled already (nohup) is left as it is, and so are all outside the main thread.
    """
    main = threading.current_thread() is threading.main_thread()
    free = [number for number in _ENDING if main and signal.getsignal(number) == signal.SIG_DFL]
    _received.clear()
    for number in free:
        signal.signal(number, _terminate)
    try:
        yield
    except Exception:
        raise_lost_signal()
        raise
    finally:
        for number in free:
            signal.signal(number, signal.SIG_DFL)


def _terminate(number: int, frame: FrameType | None) -> None:
    _received.append(Terminated(number))
    raise _received[-1]


def raise_lost_signal() -> None:
    """Raise Terminated again if a signal was received: a C extension that is being imported turns it into an ImportError."""
    if _received:
        raise _received[-1]


def end_with_parent(patience: float = 0.0) -> None:
    """In a worker process: end when the parent process does, and leave SIGINT and SIGHUP to it: it stops the workers.

    patience: seconds between the SIGTERM that a worker without a parent gets, and its end in any case.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    threading.Thread(target=_watch_parent, args=(patience,), daemon=True).start()


def _watch_parent(patience: float) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(patience)
        os._exit(1)


class Stopping:
    """Says, when called, whether SIGINT or SIGTERM was received in the `with` block. A second signal has its usual effect."""

    def __init__(self) -> None:
        self._signal = 0
        self._before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def __call__(self) -> bool:
        """Whether to stop."""
        return bool(self._signal)

    @property
    def code(self) -> int:
        """Exit code: 130 when interrupted, otherwise 0, because SIGTERM is the normal way to stop a service."""
        return INTERRUPTED if self._signal == signal.SIGINT else 0

    def __enter__(self) -> "Stopping":
        for number in self._before:
            signal.signal(number, self._stop)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._restore()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        # Do no more than this here: the code that the signal interrupts may hold a lock.
        self._signal = number
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
