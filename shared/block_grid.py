"""The coarse grid of blocks over a frame, and the K x K patches between them (section 3, Fig.
2).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import BoolArray, FloatArray, IndexArray
from .errors import InputError


@dataclass(frozen=True)
class BlockGrid:
    """The coarse grid of blocks, and the K x K patches between them, over one frame.

    A patch begins in the middle of a block, so that its four corners lie in four blocks, or next to
    them if these are not 2 x 2 (Fig. 2). Patches cover the frame; the frame mirrored out to whole
    patches is the *padded frame*. Block [0, 0] is at the top left corner of the first patch. Blocks
    that lie partly or wholly outside the frame measure nothing and take the values of the nearest
    whole one.

    Attributes
    ----------
    period : int
        K.
    block_origin : tuple[int, int]
        (row, column) of the top left pixel of a block in the frame, each 0 to K - 1.
    block_shape : tuple[int, int]
        (rows, columns) of a block.
    frame : tuple[int, int]
        (rows, columns) of the frame.

    Raises
    ------
    InputError
        When no whole block lies inside the frame.

    Examples
    --------
    >>> from panchroma.shared import CfaPattern
    >>> grid = CfaPattern.bayer(6).grid((13, 20))
    >>> grid.shape, grid.patches  # blocks and patches, (down, across)
    ((4, 6), (3, 5))
    >>> grid.rows.tolist(), grid.whole_rows.tolist()  # the outermost rows do not fit
    ([-6, 0, 6, 12], [0, 6])
    """

    period: int
    block_origin: tuple[int, int]
    block_shape: tuple[int, int]
    frame: tuple[int, int]

    def __post_init__(self) -> None:
        if not self.inside.any():
            (rows, columns), side = self.frame, 2 * self.period
            reason = f"a frame of {columns} x {rows} pixels holds no whole colour block"
            always = f"{side} x {side} pixels always do"
            raise InputError(f"{reason} of this pattern (period {self.period}); {always}")

    @cached_property
    def padding(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Pixels ((above, below), (left, right)) by which the frame is mirrored out to whole
        patches.
        """
        middle = np.add(self.block_origin, np.floor_divide(self.block_shape, 2))
        above, left = (-middle % self.period).tolist()
        below, right = -(above + self.frame[0]) % self.period, -(left + self.frame[1]) % self.period
        return (above, below), (left, right)

    @cached_property
    def patches(self) -> tuple[int, int]:
        """Number of patches (down, across); the padded frame has K times as many rows."""
        (above, _), (left, _) = self.padding
        return -(-(above + self.frame[0]) // self.period), -(-(left + self.frame[1]) // self.period)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of blocks (down, across): the corners of the patches."""
        return self.patches[0] + 1, self.patches[1] + 1

    @cached_property
    def rows(self) -> IndexArray:
        """Frame row of the first pixel of each block row; may lie outside the frame."""
        return self._origins(0)

    @cached_property
    def columns(self) -> IndexArray:
        """Frame column of the first pixel of each block column; may lie outside the frame."""
        return self._origins(1)

    @cached_property
    def inside(self) -> BoolArray:
        """Mask of the blocks that lie wholly inside the frame; bool `shape`."""
        (height, width), (rows, columns) = self.frame, self.block_shape
        down = (self.rows >= 0) & (self.rows + rows <= height)
        across = (self.columns >= 0) & (self.columns + columns <= width)
        return down[:, None] & across[None, :]

    @cached_property
    def whole(self) -> tuple[slice, slice]:
        """The rows and columns of blocks that lie wholly inside the frame."""
        down, across = (np.flatnonzero(self.inside.any(axis=axis)) for axis in (1, 0))
        return slice(int(down[0]), int(down[-1]) + 1), slice(int(across[0]), int(across[-1]) + 1)

    @property
    def whole_rows(self) -> IndexArray:
        """The `rows` of whole blocks: frame row of the first pixel of each block row that lies
        inside the frame.
        """
        return self.rows[self.whole[0]]

    @property
    def whole_columns(self) -> IndexArray:
        """The `columns` of whole blocks: frame column of the first pixel of each block column that
        lies inside the frame.
        """
        return self.columns[self.whole[1]]

    def extend(self, measured: FloatArray) -> FloatArray:
        """Extend values of the whole blocks, (whole rows, whole columns, ...), to all blocks: the
        others copy the nearest one.
        """
        (rows, columns), (down, across) = self.whole, self.shape
        outside = [(rows.start, down - rows.stop), (columns.start, across - columns.stop)]
        outside += [(0, 0)] * (measured.ndim - 2)
        return np.ascontiguousarray(np.pad(measured, outside, mode="edge"))

    def _origins(self, axis: int) -> IndexArray:
        first = -self.padding[axis][0] - self.block_shape[axis] // 2
        return first + self.period * np.arange(self.shape[axis])
