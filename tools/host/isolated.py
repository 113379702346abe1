"""One function call in a process of its own, so that the time to start it and the memory it needs can be measured.

Imports the standard library alone: a new process loads this module before anything is measured.
"""

import multiprocessing
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ParamSpec, TypeVar

from .signals import end_with_parent, held_back

P = ParamSpec("P")
R = TypeVar("R")

_STATUS = "/proc/self/status"  # preferred to getrusage, where a new process inherits the peak of the one that started it


def run_isolated(function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
    """Call `function` in a new process and return its result. The process has ended when this returns or is interrupted.

    function: defined at the top level of a module, because it is pickled.
    Raises what `function` raises, and InputError when its process is killed.
    """
    context = multiprocessing.get_context("spawn")
    receiving, sending = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(sending, function, arguments, named))
    with held_back():
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
    end_with_parent()
    try:
        sending.send((True, function(*arguments, **named)))
    except Exception as error:
        sending.send((False, error))


def peak_memory() -> int:
    """Peak resident memory of this process, bytes."""
    return system_figure(_STATUS, "VmHWM") or _usage()


def memory_now() -> int:
    """Resident memory of this process now, bytes; its peak where the system does not say."""
    return system_figure(_STATUS, "VmRSS") or _usage()


def system_figure(file: str, name: str) -> int:
    """Return the bytes that a file of the system, with lines such as "MemAvailable: 12 kB", has under a name; 0 = unknown."""
    with suppress(OSError), Path(file).open(encoding="ascii") as lines:
        return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)
    return 0


def _usage() -> int:
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024
