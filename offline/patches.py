"""Coordinates of patches, chunks and bands of a frame, and of the padded frame (the frame mirrored
out to whole patches).

A band is a whole number of rows of chunks, without their halos (see `stages.affinity`).
"""

import numpy as np

from ..shared.arrays import BORDER, FloatArray, Pair
from ..shared.block_grid import BlockGrid

HALO = 2
"""Patches around a chunk that are solved with it. Fields are then off by at most 0.007, by 1e-4 rms
(photographs): a tenth of the error that a residual of 1e-3 leaves.
"""
# Pixels of a chunk with its halo, down and across, and patches without it. Few rows make low bands,
# which need less memory; longer chunks solve less of their halos.
_CHUNK, _LEAST_PATCHES = (144, 288), 8
# The least number of rows of a band, so that every thread has work. Wide frames need fewer rows for
# that: their bands have about `_ENOUGH` pixels, so that the planes of a band fit in the cache and
# their memory is reused.
_BAND, _ENOUGH = 192, 400_000


def chunk_patches(period: int) -> tuple[int, int]:
    """The number of rows, and of columns, of patches in a chunk without its halo.

    Parameters
    ----------
    period : int
        K, pixels.
    """
    down, across = (max(_LEAST_PATCHES, pixels // period - 2 * HALO) for pixels in _CHUNK)
    return down, across


def band_rows(grid: BlockGrid) -> list[tuple[int, int]]:
    """First row and end of the bands of a frame, from top to bottom: they end where chunks do."""
    (height, width), ((above, _), _) = grid.frame, grid.padding
    chunk = chunk_patches(grid.period)[0] * grid.period
    step = -(-min(_BAND, -(-_ENOUGH // width)) // chunk) * chunk
    ends = [*range(step - above, height, step), height]
    return list(zip([0, *ends], ends, strict=False))


def patches_of(grid: BlockGrid, rows: tuple[int, int]) -> tuple[int, int]:
    """First row and end of the patches that show these rows of the frame."""
    (above, _), _ = grid.padding
    return (rows[0] + above) // grid.period, -(-(rows[1] + above) // grid.period)


def padded_rows(luminance: FloatArray, grid: BlockGrid, patches: Pair, reach: int) -> FloatArray:
    """Luminance in some rows of patches of the padded frame, float32 (rows, columns).

    Parameters
    ----------
    luminance : FloatArray
        (H, W), the whole frame.
    patches : Pair
        First and end row of patches.
    reach : int
        Number of rows and columns added at both ends, mirrored once more.
    """
    axes = zip(grid.frame, grid.padding, strict=True)
    whole = (np.pad(np.arange(size), padding, mode=BORDER) for size, padding in axes)
    rows, columns = (np.pad(places, reach, mode=BORDER) for places in whole)
    first, end = patches[0] * grid.period, patches[1] * grid.period + 2 * reach
    return luminance[rows[first:end]].take(columns, axis=1)
