"""How a frame is rendered in bands of rows, and the domain (the frame mirrored out to whole patches): arithmetic only.

Fields are solved on regions whose cores begin at multiples of a number of patches, wherever bands do; refinement looks a certain
number of rows up and down. So a band is some rows of cores, and its picture ends where refinement would look past them: the rest
waits for the next band. Nothing is computed twice, and nothing differs from the frame rendered as a whole.
"""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BORDER, IndexArray
from shared.pattern import BlockGrid

# Rows of a band at least, so that all threads have something to do; fewer where it is so wide that so many pixels are enough: the
# planes of a band then stay small, in the cache and in memory that is used again.
_BAND, _ENOUGH = 192, 400_000


@dataclass(frozen=True)
class Band:
    """One step of a rendering from top to bottom.

    patches: first and end row of the patches whose fields are solved; rows: first and end row of the frame that are finished with
    them, none if both are the same; kept: first row that the bands after this one look back to.
    """

    patches: tuple[int, int]
    rows: tuple[int, int]
    kept: int


def bands(grid: BlockGrid, core: int, reach: int) -> list[Band]:
    """The bands of a frame, from top to bottom. core: patches of a region's core; reach: rows that refinement looks up and down."""
    (above, _), _ = grid.padding
    (height, width), count = grid.frame, grid.patches[0]
    step = -(-min(_BAND, -(-_ENOUGH // width)) // (core * grid.period)) * core
    found, done = [], 0
    for first in range(0, count, step):
        end = min(first + step, count)
        stop = height if end == count else max(end * grid.period - above - reach, done)
        found.append(Band((first, end), (done, stop), max(stop - reach, 0)))
        done = stop
    return found


def domain_places(grid: BlockGrid, reach: int = 0) -> tuple[IndexArray, IndexArray]:
    """The frame's row at each row of the domain, and its column at each column; `reach` more at both ends, mirrored once more."""
    rows, columns = (
        np.pad(np.pad(np.arange(size), padding, mode=BORDER), reach, mode=BORDER)
        for size, padding in zip(grid.frame, grid.padding, strict=True)
    )
    return rows, columns
