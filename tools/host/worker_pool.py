"""Long-lived worker processes that share a list of work. A worker that dies is replaced, and its piece is tried once more."""

import multiprocessing
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Any, Generic, NoReturn, ParamSpec, TypeVar

from shared.errors import InputError, PanchromaError

from .console import WorkerFault, fault
from .processors import limited_threads
from .signals import end_with_parent, held_back, insist, raise_lost_signal

A = ParamSpec("A")
P = TypeVar("P")
R = TypeVar("R")
Note = Callable[[str], None]

_DEATHS = 2  # a piece of work that has killed this many workers is given up
_PATIENCE = 10.0  # seconds that workers get to leave in order before they are killed


def run(
    work: Callable[[P, Note], R], pieces: Sequence[P], count: int, *, note: Note, remedy: str, threads: int = 1
) -> Iterator[tuple[P, R | PanchromaError | MemoryError]]:
    """Call `work(piece, note)` for each piece and yield (piece, result), in the order in which pieces end.

    A PanchromaError or MemoryError that `work` raises is the result of its piece, and so is the InputError for a piece that
    killed its worker twice. Raises WorkerFault for any other exception in a worker. When the iteration is left early, by an
    interrupt too, all workers are told to stop: they remove what is half written, and are killed if that takes too long.

    work: a function of a module, or a `partial` of one. It, the pieces and the results are pickled.
    count: number of processes; with one, or for one piece, the work is done in this process.
    note: called in this process with each text that `work` passes to its own `note`.
    remedy: ends the message about a piece that kills its workers.
    threads: number of threads of the numerical libraries in each worker.
    """
    count = min(count, len(pieces))
    raise_lost_signal()
    if count <= 1:
        for piece in pieces:
            raise_lost_signal()
            yield piece, result_or_error(work, piece, note)
        return
    queue = deque(enumerate(pieces))
    deaths: Counter[int] = Counter()
    workers: dict[Any, _Worker[P, R]] = {}
    try:
        with limited_threads(threads):
            while queue or workers:
                while queue and len(workers) < count:
                    worker = _Worker(work)
                    workers[worker.connection] = worker
                    worker.give(*queue.popleft())
                for connection in wait(list(workers)):
                    worker = workers[connection]
                    piece = worker.piece
                    try:
                        kind, content = worker.connection.recv()
                    except (EOFError, OSError):  # it has died: the loop begins again with another one
                        workers.pop(connection).leave()
                        deaths[worker.number] += 1
                        if deaths[worker.number] < _DEATHS:
                            queue.appendleft((worker.number, piece))
                        else:
                            yield piece, InputError(f"its process was killed, most likely for want of memory; {remedy}")
                        continue
                    if kind == _NOTE:
                        note(content)
                        continue
                    if kind == _FAULT:
                        raise WorkerFault(content)
                    if queue:  # first the next piece, so that the worker need not wait until the result is used
                        worker.give(*queue.popleft())
                    else:
                        workers.pop(connection).leave()
                    yield piece, content
    finally:
        for worker in workers.values():
            worker.process.terminate()
        deadline = time.monotonic() + _PATIENCE
        for worker in workers.values():
            worker.leave(deadline)


def result_or_error(work: Callable[A, R], *arguments: A.args, **named: A.kwargs) -> R | PanchromaError | MemoryError:
    """What `work` returns, or the error of ours that it raises: what is wrong with one piece must not stop the others."""
    try:
        return work(*arguments, **named)
    except (PanchromaError, MemoryError) as error:
        return error


_NOTE, _RESULT, _FAULT = range(3)


class _Worker(Generic[P, R]):
    """One process, and the piece of work that it has."""

    piece: P
    number: int

    def __init__(self, work: Callable[[P, Note], R]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        with held_back():
            self.process.start()
        theirs.close()  # otherwise the pipe would stay open after the process has ended

    def give(self, number: int, piece: P) -> None:
        """Send the next piece of work."""
        self.number, self.piece = number, piece
        with suppress(OSError):  # it has died: receiving from it will show that
            self.connection.send(piece)

    def leave(self, deadline: float | None = None) -> None:
        """Close the pipe, wait until the process ends, kill it at the deadline."""
        self.connection.close()
        self.process.join(_PATIENCE if deadline is None else max(0.0, deadline - time.monotonic()))
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def _serve(connection: Connection, work: Callable[[P, Note], R]) -> None:
    """In the worker process: do the pieces that come through the pipe until it closes."""
    signal.signal(signal.SIGTERM, _stop)
    end_with_parent(_PATIENCE)

    def note(text: str) -> None:
        with suppress(OSError):  # the parent has ended
            connection.send((_NOTE, text))

    with suppress(EOFError, OSError):
        while True:
            piece = connection.recv()
            try:
                message: tuple[int, Any] = _RESULT, result_or_error(work, piece, note)
            except Exception as error:
                message = _FAULT, fault(error)
            connection.send(message)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    insist(number)
    raise SystemExit(128 + number)  # runs every `finally` on its way: nothing stays half-written
