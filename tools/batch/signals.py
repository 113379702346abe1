"""Signals that end a program: commands clean up, services finish their current work, workers end with their parent."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_DEFAULT = (signal.SIG_DFL, signal.default_int_handler)
_AGAIN = 0.05  # seconds until a signal that was dropped is sent again
_received: list["Terminated"] = []  # raised since `orderly_end` began, even if something has caught it


class Terminated(KeyboardInterrupt):
    """SIGINT, SIGTERM or SIGHUP was received. A KeyboardInterrupt: what cleans up after an interrupt does so after each of them."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


@contextmanager
def orderly_end(*, last: bool = False) -> Iterator[None]:
    """In the `with` block SIGINT, SIGTERM and SIGHUP raise Terminated; by default the last two would leave temporary files behind.

    last: the program ends after the block: from then on they end it at once. All files are written, and a traceback helps nobody.

    A signal that is ignored or handled already (nohup) is left as it is, and so are all outside the main thread.
    """
    before = {number: signal.getsignal(number) for number in _ENDING if _in_main_thread()}
    free = [number for number, handler in before.items() if handler in _DEFAULT]
    _received.clear()
    hook = sys.unraisablehook
    for number in free:
        signal.signal(number, _terminate)
    try:
        yield
    except Exception:
        raise_lost_signal()
        raise
    finally:
        for number in free:
            signal.signal(number, _leave if last else before[number])
        sys.unraisablehook = hook


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _terminate(number: int, frame: FrameType | None) -> None:
    send_again_if_lost(number)
    _received.append(Terminated(number))
    raise _received[-1]


def _leave(number: int, frame: FrameType | None) -> None:
    os._exit(128 + number)


def send_again_if_lost(number: int) -> None:
    """In the handler of a signal: send it again if the exception that the handler raises gets lost.

    Inside a callback from C (Numba loading a kernel) it is dropped, with a traceback.
    """
    again = threading.Timer(_AGAIN, signal.pthread_kill, (threading.main_thread().ident, number))
    again.daemon = True
    usual = sys.unraisablehook  # restored by `orderly_end`

    def dropped(lost: "sys.UnraisableHookArgs") -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt | SystemExit):
            again.start()
        else:
            usual(lost)

    sys.unraisablehook = dropped


@contextmanager
def deferred_signals() -> Iterator[None]:
    """In the `with` block a process is started: signals that end this one wait until it is complete.

    Otherwise the new process would be left with half of its orders, and show a traceback. It never gets SIGINT, not even while it
    is importing: an interrupt at a terminal goes to all processes, but it is for this one, which stops the others.
    """
    from multiprocessing import resource_tracker  # here: an interrupt while the command line is imported shows a traceback

    resource_tracker.ensure_running()  # when it starts, with the first process, it unblocks SIGINT
    held: list[int] = []
    numbers = [number for number in _ENDING if _in_main_thread() and signal.getsignal(number) is not None]  # None: set from C
    before = {number: signal.signal(number, lambda number, _: held.append(number)) for number in numbers}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the process inherits it; threads of ours may still get it
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for received in held:
            signal.raise_signal(received)


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
    import multiprocessing.connection

    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(patience)
        os._exit(1)


@contextmanager
def starting_service() -> Iterator[None]:
    """In the `with` block a service starts, which may take until its first frame: SIGTERM ends it with exit code 0, as later."""
    try:
        yield
    except Terminated as ended:
        if ended.code == 128 + signal.SIGTERM:
            sys.exit(0)
        raise


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

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        # Do no more than this here: the code that the signal interrupts may hold a lock.
        self._signal = number
        self.__exit__()
