"""Call a function for many items: one after the other, in threads, or in processes.

Each way yields (item, result or exception) as items finish: an item that fails does not stop the
others.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .console import LOG, WorkerFault, fault, shown_by, traceback_of
from .signals import ENDING, raise_lost_signal

if TYPE_CHECKING:  # it loads NumPy, before a worker process has set the number of its threads
    from .progress import Note, StageProgress

P = TypeVar("P")
R = TypeVar("R")
Function = Callable[[P, "StageProgress"], R]
"""Called with an item and a listener, which takes the stages and notes of the item."""
Listen = Callable[[P], "StageProgress"]
"""Makes the listener of an item."""
Results = Iterator[tuple[P, R | Exception]]
"""(item, what the function returned, or the exception that it raised)."""

_OF_LIBRARIES = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"
THREAD_VARIABLES = (*_OF_LIBRARIES, "OPENCV_FOR_THREADS_NUM", "PANCHROMA_THREADS")
"""Environment variables that numerical libraries read when they are loaded."""
_AHEAD = 1000  # calls submitted at a time: there may be a million items
_POLL_POOL = 1.0  # seconds without a result after which the pool is looked at
_STARTS = 3  # of a pool whose processes die before they have an item


def one_by_one(work: Function[P, R], items: Iterable[P], listen: Listen[P]) -> Results[P, R]:
    """Call a function in this thread.

    listen: makes the listener of an item, for a `with` block.
    """
    for item in items:
        raise_lost_signal()
        with listen(item) as listener:
            result = _result_or_error(work, item, listener)
        yield item, result


def in_threads(work: Function[P, R], items: Sequence[P], count: int, note: Note) -> Results[P, R]:
    """Call a function in threads; yield in the order of the items.

    count: number of threads, 1 or more. note: called with each note of an item, in any of the
    threads.
    """
    from ..io.ahead import ahead
    from .progress import StageProgress

    def call(item: P) -> R | Exception:
        return _result_or_error(work, item, StageProgress(note=note))

    yield from zip(items, ahead(call, items, count), strict=True)


@contextmanager
def in_processes(
    work: Function[P, R], items: Sequence[P], count: int, note: Note, remedy: str, threads: int = 1
) -> Iterator[Results[P, R]]:
    """Call a function in processes of this machine; the `with` block gets the results as items
    finish. Functions, items and results are pickled.

    The processes are killed at the end of the block, whatever they are at. Files that are half
    written then are swept by whoever knows their folders (`shared.writing.sweep`).

    Parameters
    ----------
    work
        Of a module, or a `partial` of one.
    items
        Any number; 1000 are submitted at a time. One whose process was killed ends with an
        InputError.
    count
        Number of processes. A process that dies is replaced.
    note
        Called in this thread with each note of an item.
    remedy
        What the user can do about a killed process.
    threads
        Number of threads of the numerical libraries in each process.
    """
    from pebble import ProcessExpired, ProcessPool

    from ...shared.errors import InputError

    try:
        Path.cwd()  # where processes begin
    except OSError:
        gone = "the current folder is gone, or not to be read"
        raise InputError(f"{gone}; change to another one") from None
    before, spawn = set(multiprocessing.active_children()), _SafeSpawn()
    pools: list[ProcessPool] = []  # the last one is at work
    settings = {"initializer": _begin, "initargs": (threads, LOG.getEffectiveLevel())}

    def start() -> None:
        if len(pools) == _STARTS:
            raise InputError(f"processes are killed as soon as they start; {remedy}")
        pools.append(ProcessPool(count, context=spawn, **settings))
        with _blocked_signals():
            pools[-1].active  # noqa: B018  starts it

    def stop() -> None:
        pools[-1].stop()
        for child in set(multiprocessing.active_children()) - before:
            child.kill()  # all at once: the pool would wait for one after the other
        pools[-1].join()

    def results() -> Results[P, R]:
        waiting = deque(items)
        running: dict[Future[tuple[Any, list[str]]], P] = {}
        while waiting or running:
            if not pools[-1].active:  # a process died before it had an item
                unfinished = [future for future in running if not future.done()]
                waiting.extendleft(running.pop(future) for future in unfinished)
                stop()
                start()
            with suppress(RuntimeError):  # the pool has failed meanwhile: see above
                while waiting and len(running) < _AHEAD:
                    future = pools[-1].schedule(_call, (work, waiting[0]))
                    running[future] = waiting.popleft()
            done, _ = wait(running, _POLL_POOL, FIRST_COMPLETED)
            raise_lost_signal()
            for future in done:
                item = running.pop(future)
                notes: list[str] = []
                try:
                    result, notes = future.result()
                except ProcessExpired as end:
                    killed = f"its process ended with exit code {end.exitcode}"
                    if end.exitcode == -signal.SIGKILL:
                        killed = "its process was killed, most likely for want of memory"
                    result = InputError(f"{killed}; {remedy}")
                except BrokenExecutor:  # as above
                    waiting.appendleft(item)
                    continue
                for text in notes:
                    note(text)
                yield item, result

    try:
        start()
        yield results()
    finally:
        stop()


def _safe_path() -> AbstractContextManager[None]:
    """Let Python that starts import nothing from the current folder: a file may be called
    types.py.
    """
    from ...shared.environment import environment

    return environment("PYTHONSAFEPATH", "1")


class _SafeProcess(SpawnProcess):
    """A process that starts with a safe path; then it has that of this program."""

    def start(self) -> None:
        """Start it."""
        with _safe_path():
            super().start()


class _SafeSpawn(SpawnContext):
    Process = _SafeProcess


def possible_processes(count: int, note: Note) -> int:
    """Return `count`, or 1 and a note where processes cannot share work."""
    spawn = _SafeSpawn()
    try:
        with _safe_path():  # of the process that looks after semaphores
            _ = count > 1 and [spawn.RLock(), spawn.RLock()]  # as many as a pool has
    except (ImportError, OSError) as error:
        reason = getattr(error, "strerror", error)
        note(f"one process does all the work: no semaphore can be made in /dev/shm ({reason})")
        return 1
    return count


@contextmanager
def _blocked_signals() -> Iterator[None]:
    """Block signals in this thread, and in all threads and processes that are started in the `with`
    block.

    An interrupt at a terminal goes to all processes: one that is still importing would show a
    traceback.
    """
    from multiprocessing import resource_tracker

    with _safe_path():
        resource_tracker.ensure_running()  # when it starts, it unblocks SIGINT in Python 3.11
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(threads: int, level: int) -> None:
    """Prepare a worker process, before it loads a numerical library."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # by which the pool stops it
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(threads)))
    LOG.setLevel(level)


def _call(function: Function[P, R], item: P) -> tuple[R | Exception, list[str]]:
    """In a worker: (result or exception, notes). The exception carries its traceback, or that of
    its cause, as a note.
    """
    from ...shared.errors import PanchromaError
    from .progress import StageProgress

    notes, level = list[str](), LOG.getEffectiveLevel()
    with shown_by(notes.append, level), StageProgress(str(item), notes.append) as listener:
        result = _result_or_error(function, item, listener)
    if isinstance(result, Exception):
        trace = traceback_of(result)
        if not isinstance(result, PanchromaError | MemoryError):
            result = WorkerFault(fault(result))
        result.add_note(trace)  # pickling drops the cause
    return result, notes


def _result_or_error(function: Function[P, R], item: P, listener: StageProgress) -> R | Exception:
    """Call the function; return its result, or the exception that it raises. An interrupt, which is
    no `Exception`, is raised.
    """
    try:
        return function(item, listener)
    except Exception as error:
        return error


def follow(
    results: Results[P, R], items: Sequence[P], progress: StageProgress, name: str = ""
) -> Results[P, R]:
    """Yield the results, and show how far the whole is and how long the rest will take.

    Parameters
    ----------
    results, items
        The results of these items, in any order.
    progress
        Shows it.
    name
        Name of the stage; "" = no name.
    """
    whole, start = len(items), time.monotonic()
    progress.stage(name, whole)
    for number, (item, result) in enumerate(results, 1):
        progress.advance()
        remark = f"{number} of {whole} done"
        if number < whole:
            left = (time.monotonic() - start) * (whole - number) / number
            remark += f", about {duration(left)} left"
        progress.remark(remark)
        yield item, result


def duration(seconds: float) -> str:
    """Format a time for people: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02} min"
