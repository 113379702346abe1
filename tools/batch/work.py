"""A list of pieces of work, one after the other or several at a time, and how far it is.

There are four ways to work, each called as `workers(work, pieces)`: `Here` and `Threads`, and for work that is pickled
`processes.Processes` and `cluster.Cluster`.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from tools.io.ahead import ahead

from .console import StandardOutputError, WorkerFault, fault, traceback_of
from .progress import Note, StageProgress
from .signals import raise_lost_signal

P = TypeVar("P")
R = TypeVar("R")

_PARTS = 10  # steps of a progress bar per unit of length


Workers = Callable[[Callable[[P, StageProgress], R], Sequence[P]], Iterator[tuple[P, R | Exception]]]
"""A way to work: yields (piece, what `work(piece, listener)` returns, or the exception that it raises) as pieces end.

The listener takes the stages and the notes of this piece.
"""


@dataclass(frozen=True)
class Here:
    """One after the other, in this thread. listen: makes the listener of a piece, which is used in a `with` block."""

    listen: Callable[[Any], StageProgress]

    def __call__(self, work: Callable[[P, StageProgress], R], pieces: Sequence[P], /) -> Iterator[tuple[P, R | Exception]]:
        """See `Workers`."""
        for piece in pieces:
            raise_lost_signal()
            with self.listen(piece) as listener:
                result = result_or_error(work, piece, listener)
            yield piece, result


@dataclass(frozen=True)
class Threads:
    """By `count` threads, in the order of the pieces; whoever interrupts waits for those that have begun."""

    count: int
    note: Note

    def __call__(self, work: Callable[[P, StageProgress], R], pieces: Sequence[P], /) -> Iterator[tuple[P, R | Exception]]:
        """See `Workers`."""
        results = ahead(lambda piece: result_or_error(work, piece, StageProgress(note=self.note)), pieces, self.count)
        yield from zip(pieces, results, strict=True)


def result_or_error(work: Callable[[P, StageProgress], R], piece: P, listener: StageProgress) -> R | Exception:
    """What `work` returns, or the exception that it raises: what is wrong with one piece must not stop the others.

    Only an unwritable standard output does, and what is no `Exception`: an interrupt.
    """
    try:
        return work(piece, listener)
    except StandardOutputError:
        raise
    except Exception as error:
        return error


def portable(result: R | Exception) -> R | Exception:
    """A result that another process can read: an exception that nobody foresaw becomes a WorkerFault, with its traceback."""
    from shared.errors import PanchromaError

    if isinstance(result, Exception) and not isinstance(result, PanchromaError | MemoryError):
        return WorkerFault(fault(result), traceback_of(result))
    return result


def follow(
    workers: Workers[P, R],
    work: Callable[[P, StageProgress], R],
    pieces: Sequence[P],
    progress: StageProgress,
    name: str = "",
    length: Callable[[P], float] = lambda _: 1.0,
) -> Iterator[tuple[P, R | Exception]]:
    """As `workers(work, pieces)`, while `progress` shows how far the whole is, and how long the rest will take.

    name: of the stage; "" = it has none.
    length: a piece's share of the work, in any unit.
    """
    if not pieces:
        return
    whole, done, start = sum(map(length, pieces)), 0.0, time.monotonic()
    progress.stage(name, round(_PARTS * whole))
    for number, (piece, result) in enumerate(workers(work, pieces), 1):
        done += length(piece)
        progress.advance(round(_PARTS * length(piece)))
        left = (time.monotonic() - start) * max(whole - done, 0) / done if done else 0
        progress.remark(f"{number} of {len(pieces)} done" + f", about {duration(left)} left" * (left > 0 and number < len(pieces)))
        yield piece, result


def duration(seconds: float) -> str:
    """A time for people: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02} min"
