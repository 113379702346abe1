"""Distribution of work among threads, in chunks that do not depend on each other.

The calling thread works, too. Others are started for each call, which takes 0.1 to 0.5 ms, and end
with it: those that stay would be lost in a child made by fork. Several threads may call at a time.
"""

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from ...shared.arrays import STRIP, strips
from ...shared.processors import chosen, threads

BLOCK_ROWS = 32
"""Rows of blocks that are computed together, about as many rows of a picture as in `STRIP`."""


def in_chunks(work: Callable[[int, int], object], chunks: int, together: int = 1) -> None:
    """Call `work(first, end)` for ranges that together are 0 to `chunks`, in `threads()` threads.

    Raises what `work` raises.

    Parameters
    ----------
    together : int, optional
        The most chunks in a range. When an interrupt or an error comes, only ranges that have begun
        are finished.
    """
    # shared by all threads
    ranges = iter([(start, min(start + together, chunks)) for start in range(0, chunks, together)])
    others = min(threads(), -(-chunks // together)) - 1
    if others < 1:
        for first, end in ranges:
            work(first, end)
        return

    def drain() -> None:
        before, chosen.count = chosen.count, 1  # what a chunk calls shares nothing once more
        try:
            for first, end in ranges:
                work(first, end)
        finally:
            chosen.count = before
            deque(ranges, maxlen=0)  # after an error the others begin nothing more

    with ThreadPoolExecutor(others, "panchroma") as executor:
        try:
            started = [executor.submit(drain) for _ in range(others)]
            drain()
        finally:
            deque(ranges, maxlen=0)  # after an interrupt
        for other in started:
            other.result()


def in_strips(work: Callable[[slice], object], rows: int, height: int = STRIP) -> None:
    """Call `work` for the slices of `strips(rows, height)`, as `in_chunks` does."""
    every = list(strips(rows, height))
    in_chunks(lambda first, _: work(every[first]), len(every))
