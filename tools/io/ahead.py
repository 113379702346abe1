"""Map a function over an iterable in background threads, reading ahead by one item."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

P = TypeVar("P")
R = TypeVar("R")

WAITING = 1
"""Items, beside one per thread, that wait until they are worked on or used."""


def ahead(work: Callable[[P], R], items: Iterable[P], threads: int = 1) -> Iterator[R]:
    """Yield `work(item)` for each item, in order; `work` runs in threads of its own, `items` are
    taken in this one.

    It pays where `work` spends its time in NumPy, in a codec or on a file, which let other threads
    run. At most `threads + WAITING` items are held. Raises what `work` and `items` raise. When the
    iteration is left early, items that have begun are finished, and the others are dropped.

    Examples
    --------
    >>> from panchroma.tools.io.ahead import ahead
    >>> list(ahead(abs, [-1, 2, -3]))
    [1, 2, 3]
    """
    pending: deque[Future[R]] = deque()
    pool = ThreadPoolExecutor(threads, "ahead")
    try:
        for item in items:
            pending.append(pool.submit(work, item))
            while pending and (len(pending) >= threads + WAITING or pending[0].done()):
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
