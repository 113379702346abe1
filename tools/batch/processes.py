"""Long-lived worker processes that share a list of work. A worker that dies is replaced, and its piece is tried once more."""

import multiprocessing
import pickle
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Any, Generic, NoReturn, TypeVar

from shared.errors import InputError

from .console import note_warnings
from .progress import Note, StageProgress
from .signals import deferred_signals, end_with_parent, raise_lost_signal, send_again_if_lost
from .work import Here, portable, result_or_error
from .worker import begin

P = TypeVar("P")
R = TypeVar("R")

_DEATHS = 2  # a piece of work that has killed this many workers is given up
_PATIENCE = 10.0  # seconds that workers get to leave in order before they are killed


@dataclass(frozen=True)
class Processes:
    """A way to work (`tools.batch.work.Workers`): by processes. A process that dies is replaced.

    Work, pieces and results are pickled: the work is a function of a module, or a `partial` of one. The result of a piece that has
    killed its process twice is an InputError. When the iteration is left early, by an interrupt too, all processes are told to
    stop: they remove what is half written, and are killed if that takes too long.

    count: number of processes; with one, or for one piece, the work is done in this process.
    note: called in this process with the notes of the work.
    remedy: ends the message about a piece that kills its process.
    threads: number of threads of the numerical libraries in each process.
    """

    count: int
    note: Note
    remedy: str
    threads: int = 1

    def __call__(self, work: Callable[[P, StageProgress], R], pieces: Sequence[P], /) -> Iterator[tuple[P, R | Exception]]:
        """See `Workers`."""
        raise_lost_signal()
        if min(self.count, len(pieces)) <= 1:
            yield from Here(lambda _: StageProgress(note=self.note))(work, pieces)
            return
        workers: dict[Any, _Worker[P]] = {}
        try:
            yield from self._results(pickle.dumps(work), deque(enumerate(pieces)), workers)
        finally:
            for worker in workers.values():
                worker.process.terminate()
            deadline = time.monotonic() + _PATIENCE
            for worker in workers.values():
                worker.leave(deadline)

    def _results(
        self, work: bytes, queue: deque[tuple[int, P]], workers: "dict[Any, _Worker[P]]"
    ) -> Iterator[tuple[P, R | Exception]]:
        """Yield what comes from the workers, which are kept in `workers`, until the queue is empty and all are done."""
        deaths: Counter[int] = Counter()
        while queue or workers:
            while queue and len(workers) < self.count:
                worker: _Worker[P] = _Worker(work, self.threads)
                workers[worker.connection] = worker
                worker.give(*queue.popleft())
            for connection in wait(list(workers)):
                worker = workers[connection]
                piece = worker.piece
                try:
                    is_note, content = worker.connection.recv()
                except (EOFError, OSError):  # it has died: the loop begins again with another one
                    workers.pop(connection).leave()
                    deaths[worker.number] += 1
                    if deaths[worker.number] < _DEATHS:
                        queue.appendleft((worker.number, piece))
                    else:
                        yield piece, InputError(f"its process was killed, most likely for want of memory; {self.remedy}")
                    continue
                if is_note:
                    self.note(content)
                    continue
                if queue:  # first the next piece, so that the worker need not wait until the result is used
                    worker.give(*queue.popleft())
                else:
                    workers.pop(connection).leave()
                yield piece, content


class _Worker(Generic[P]):
    """One process, and the piece of work that it has."""

    piece: P
    number: int

    def __init__(self, work: bytes, threads: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=begin, args=(theirs, threads, work), daemon=True)
        with deferred_signals():
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


def serve(connection: Connection, work: Callable[[P, StageProgress], R]) -> None:
    """In the worker process: do the pieces that come through the pipe until it closes."""
    signal.signal(signal.SIGTERM, _stop)
    end_with_parent(_PATIENCE)

    def note(text: str) -> None:
        with suppress(OSError):  # the parent has ended
            connection.send((True, text))

    note_warnings(note)
    with suppress(EOFError, OSError):
        while True:
            connection.send((False, portable(result_or_error(work, connection.recv(), StageProgress(note=note)))))


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    send_again_if_lost(number)
    raise SystemExit(128 + number)  # runs every `finally` on its way: nothing stays half-written
