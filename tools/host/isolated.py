"""Work in a process of its own: what it takes to start, and how much memory it needs, is then its own too.

Nothing is imported here but what Python brings, for a new process comes by here before its clock starts.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def apart(function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
    """What `function`, one of a module, returns in a new process, which ends before this returns, by an interrupt too.

    Raises what it raises, and InputError when its process is killed.
    """
    context = multiprocessing.get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(sending, function, arguments, named))
    child.start()
    sending.close()
    try:
        done, result = receiving.recv()
    except EOFError:
        from shared.errors import InputError

        raise InputError("a process that was measured was killed, most likely for want of memory; use fewer --megapixels") from None
    finally:
        child.terminate()
        child.join()
    if not done:
        raise result
    return result  # type: ignore[no-any-return]


def _work(sending: Connection, function: Callable[..., R], arguments: tuple[object, ...], named: dict[str, object]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is for the process that waits
    threading.Thread(target=_outlive, daemon=True).start()
    try:
        sending.send((True, function(*arguments, **named)))
    except Exception as error:
        sending.send((False, error))


def _outlive() -> None:
    """Without the process that waits there is nothing to go on for."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def peak_memory() -> int:
    """Bytes that this process has had in memory at most."""
    return _status("VmHWM") or _usage()


def memory_now() -> int:
    """Bytes that it has in memory; where nobody tells, the most it has had."""
    return _status("VmRSS") or _usage()


def _status(name: str) -> int:
    # Not what getrusage says, where this is to be had: a new process inherits the figure of the one that started it.
    try:
        with Path("/proc/self/status").open(encoding="ascii") as file:
            return next((int(line.split()[1]) * 1024 for line in file if line.startswith(f"{name}:")), 0)
    except OSError:
        return 0


def _usage() -> int:
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024
