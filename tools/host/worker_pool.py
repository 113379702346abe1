"""Long-lived processes that share a list of work; one that dies is replaced, and what it was at is done again."""

import multiprocessing
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Any, Generic, NoReturn, TypeVar

from .processors import limited_threads

P = TypeVar("P")
R = TypeVar("R")
Note = Callable[[str], None]

_DEATHS = 2  # so often may a piece of work end its process before it is given up
_PATIENCE = 10.0  # seconds that a process gets to leave in order


def run(work: Callable[[P, Note], R], pieces: Sequence[P], count: int, threads: int, note: Note) -> Iterator[tuple[P, R | None]]:
    """Do `work(piece, note)` on each piece in `count` processes of `threads` threads; (piece, result), in the order they end.

    Pieces are begun in their order. The result is None when a piece has ended its process twice. `work` raises nothing; it, the
    pieces and the results are pickled. When the iteration is left early, by an interrupt too, the processes are told to stop, and
    remove what is half done.
    """
    queue = deque(enumerate(pieces))
    deaths: Counter[int] = Counter()
    crew: dict[Any, _Member[P, R]] = {}
    try:
        with limited_threads(threads):
            for _ in range(min(count, len(queue))):
                member = _Member(work)
                crew[member.connection] = member
                member.give(*queue.popleft())
            while crew:
                for connection in wait(list(crew)):
                    member = crew[connection]
                    try:
                        said, content = member.connection.recv()
                    except (EOFError, OSError):  # it is gone
                        del crew[connection]
                        member.leave()
                        deaths[member.number] += 1
                        if deaths[member.number] < _DEATHS:
                            queue.appendleft((member.number, member.piece))
                        else:
                            yield member.piece, None
                        if queue:
                            member = _Member(work)
                            crew[member.connection] = member
                            member.give(*queue.popleft())
                        continue
                    if said == _NOTE:
                        note(content)
                        continue
                    done = member.piece
                    if queue:  # before the result is looked at: it shall not wait for that
                        member.give(*queue.popleft())
                    else:
                        del crew[connection]
                        member.leave()
                    yield done, content
    finally:
        for member in crew.values():
            member.process.terminate()
        for member in crew.values():
            member.leave()


_NOTE, _RESULT = range(2)


class _Member(Generic[P, R]):
    """One process, and the piece of work that it is at."""

    piece: P
    number: int

    def __init__(self, work: Callable[[P, Note], R]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        self.process.start()
        theirs.close()  # or the end of the process would not be the end of the pipe

    def give(self, number: int, piece: P) -> None:
        """Its next piece of work."""
        self.number, self.piece = number, piece
        with suppress(OSError):  # it is gone: the next look at it tells
            self.connection.send(piece)

    def leave(self) -> None:
        """See it off: it ends with the pipe, or as soon as what it is at can be left."""
        self.connection.close()
        self.process.join(_PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def _serve(connection: Connection, work: Callable[[P, Note], R]) -> None:
    """In the process: work till there is no more, or the one who gives it is gone; what is in hand then is finished."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the interrupt is for the one who waits, who stops the others
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # and so is the end of the terminal
    signal.signal(signal.SIGTERM, _stop)

    def note(text: str) -> None:
        with suppress(OSError):  # nobody is left to tell
            connection.send((_NOTE, text))

    with suppress(EOFError, OSError):
        while True:
            connection.send((_RESULT, work(connection.recv(), note)))


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)  # passes through every `with`: nothing stays half-written
