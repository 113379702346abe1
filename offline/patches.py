"""Coordinates of patches, cores and bands of a frame, and of the domain (the frame mirrored out to
whole patches).

A band is a whole number of rows of cores (see `stages.affinity`).
"""

import numpy as np

from ..shared.arrays import BORDER, IndexArray
from ..shared.block_grid import BlockGrid

HALO = 2
"""Patches around a core that are solved with it. Fields are then off by at most 0.007, by 1e-4 rms
(photographs): a tenth of the error that a residual of 1e-3 leaves.
"""
# Pixels of a region with its halo, down and across, and patches of a core. Few rows make low bands,
# which need less memory; longer regions solve less of their surroundings.
_REGION, _LEAST_CORE = (144, 288), 8
# The least number of rows of a band, so that every thread has work. Wide frames need fewer rows for
# that: their bands have about `_ENOUGH` pixels, so that the planes of a band fit in the cache and
# their memory is reused.
_BAND, _ENOUGH = 192, 400_000


def core_patches(period: int) -> tuple[int, int]:
    """The number of rows, and of columns, of patches in the core of a region.

    Parameters
    ----------
    period : int
        K, pixels.
    """
    down, across = (max(_LEAST_CORE, pixels // period - 2 * HALO) for pixels in _REGION)
    return down, across


def band_rows(grid: BlockGrid) -> list[tuple[int, int]]:
    """First row and end of the bands of a frame, from top to bottom: they end where cores do."""
    (height, width), ((above, _), _) = grid.frame, grid.padding
    core = core_patches(grid.period)[0] * grid.period
    step = -(-min(_BAND, -(-_ENOUGH // width)) // core) * core
    ends = [*range(step - above, height, step), height]
    return list(zip([0, *ends], ends, strict=False))


def patches_of(grid: BlockGrid, rows: tuple[int, int]) -> tuple[int, int]:
    """First row and end of the patches that show these rows of the frame."""
    (above, _), _ = grid.padding
    return (rows[0] + above) // grid.period, -(-(rows[1] + above) // grid.period)


def domain_places(grid: BlockGrid, reach: int = 0) -> tuple[IndexArray, IndexArray]:
    """The frame row at each row of the domain, and the frame column at each of its columns.

    Parameters
    ----------
    reach : int, optional
        Number of rows and columns added at both ends, mirrored once more.
    """
    rows, columns = (
        np.pad(np.pad(np.arange(size), padding, mode=BORDER), reach, mode=BORDER)
        for size, padding in zip(grid.frame, grid.padding, strict=True)
    )
    return rows, columns
