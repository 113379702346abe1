"""Many pieces of work in several processes, within a limit of memory; stopped at once by an interrupt."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import TypeVar

from shared.errors import InputError, PanchromaError

from .processors import limited_threads

T = TypeVar("T")
R = TypeVar("R")

BASE_BYTES = 250 * 2**20  # of a process with its libraries
PIXEL_BYTES = 400  # of the hungriest method and its measurement, twice what was measured


def need(pixels: int) -> int:
    """Bytes that one process needs for a scene of so many pixels, roughly."""
    return BASE_BYTES + PIXEL_BYTES * pixels


def processes(wanted: int, memory: int, pixels: int) -> int:
    """How many of the wanted processes fit into `memory` bytes when the largest scene has so many pixels. 0: not even one."""
    return min(wanted, memory // need(pixels))


def run(
    work: Callable[[T], R], pieces: Sequence[T], count: int
) -> Generator[tuple[T, R | PanchromaError | MemoryError], None, None]:
    """Do `work` on each piece in `count` processes; (piece, result or error of ours), in the order in which they end.

    One process is this one. When the iteration is left early, by an interrupt too, the others are stopped at once. Raises
    InputError when a process dies.
    """
    if count <= 1 or len(pieces) <= 1:
        for piece in pieces:
            yield piece, attempt(work, piece)
        return
    with limited_threads(1):  # pieces are many and small
        pool = ProcessPoolExecutor(min(count, len(pieces)), multiprocessing.get_context("spawn"), _begin)
        ended = False
        try:
            futures = {pool.submit(attempt, work, piece): piece for piece in pieces}
            for future in as_completed(futures):
                yield futures[future], future.result()
            ended = True
        except BrokenProcessPool:
            raise InputError(
                "a process at work was killed, most likely for want of memory: run again with a smaller -j or --max-memory; "
                "what was finished is kept"
            ) from None
        finally:
            if not ended:
                for child in multiprocessing.active_children():
                    child.terminate()
            pool.shutdown(wait=ended, cancel_futures=True)


def attempt(work: Callable[[T], R], piece: T) -> R | PanchromaError | MemoryError:
    """Errors of ours are results: what is wrong with one piece stops no other."""
    try:
        return work(piece)
    except (PanchromaError, MemoryError) as error:
        return error


def _begin() -> None:
    """In a new process: the interrupt is for the one that waits, which stops the others; and without that one nothing goes on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent.sentinel,), daemon=True).start()


def _outlive(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
