"""Distribution of work among threads, in pieces that do not depend on each other.

The calling thread works, too. Others are started for each call, which takes 0.1 to 0.5 ms, and end
with it: those that stay would be lost in a child made by fork. Several threads may call at a time.
"""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import STRIP, strips
from ...shared.processors import chosen, threads

Number = TypeVar("Number", bound=np.generic)

BLOCK_ROWS = 32
"""Rows of blocks that are computed together, about as many rows of a picture as in `STRIP`."""


def in_pieces(work: Callable[[int, int], object], pieces: int, together: int = 1) -> None:
    """Call `work(first, end)` for ranges that together are 0 to `pieces`, in `threads()` threads.

    Raises what `work` raises.

    Parameters
    ----------
    together : int, optional
        The most pieces in a range. When an interrupt or an error comes, only ranges that have begun
        are finished.
    """
    # shared by all threads
    ranges = iter([(start, min(start + together, pieces)) for start in range(0, pieces, together)])
    others = min(threads(), -(-pieces // together)) - 1
    if others < 1:
        for first, end in ranges:
            work(first, end)
        return

    def drain() -> None:
        before, chosen.count = chosen.count, 1  # what a piece calls shares nothing once more
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
    """Call `work` for the slices of `strips(rows, height)`, as `in_pieces` does."""
    every = list(strips(rows, height))
    in_pieces(lambda first, _: work(every[first]), len(every))


def copy_array(plane: NDArray[Number]) -> NDArray[Number]:
    """A copy of an array: new memory takes as long to get as to write, and every thread gets its
    part.
    """
    made = np.empty(plane.shape, plane.dtype)
    copy_together([(made, plane)])
    return made


def copy_together(copies: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> None:
    """Copy arrays side by side; `copies`: (target, source) of each."""
    cut = [
        (target[rows], source[rows])
        for target, source in copies
        for rows in strips(len(target), STRIP // 4)
    ]
    in_pieces(lambda index, _: np.copyto(*cut[index]), len(cut))


def tiles(shape: tuple[int, int], tile: tuple[int, int]) -> int:
    """Number of tiles that cover a shape, the last of a row and of a column in part.

    Parameters
    ----------
    tile : tuple[int, int]
        Its height and width.
    """
    return -(-shape[0] // tile[0]) * -(-shape[1] // tile[1])
