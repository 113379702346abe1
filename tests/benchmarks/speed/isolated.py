"""One function call in a process of its own, so that the time to start it and the memory it needs can be measured.

Imports the standard library alone: a new process loads this module before anything is measured.
"""

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def run_isolated(function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
    """Call a function of a module in a new process, and return its result or raise its error."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments, **named).result()


def memory(figure: str) -> int:
    """Bytes of this process under Linux: VmHWM, its peak, or VmRSS, what it has now.

    Not from getrusage, where a new process inherits the peak of the one that started it.
    """
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{figure}:"))
