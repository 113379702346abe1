"""How one frame of a hand-held series lies against another: a shift, a rotation, and local shifts (parallax)."""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.errors import InputError

_ONE = np.float32(1)
ROUNDS = 5
"""Iterations that invert local shifts. Those differ by less than 0.1 from pixel to pixel: each divides the error by 10 or more."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the points of the reference lie in another frame of the same size.

    The point (centre + (v, u)), v down and u across, of the reference lies in the other frame at

        centre + shift + (v cos(angle) - u sin(angle), v sin(angle) + u cos(angle)) + its local shift

    where centre is ((H - 1) / 2, (W - 1) / 2).

    shift: (down, across), pixels.
    angle: radians; positive turns the picture counter-clockwise on a screen.
    local: (node rows, node columns, 2), pixels (down, across), two or more nodes along each side; None: none. The nodes are a
        regular grid, the outermost on the outermost pixels of the frame; shifts are bilinear between them.

    Raises InputError for figures that are not finite, and for another shape of `local`.

    >>> import numpy as np
    >>> from offline.burst import Motion
    >>> down, across = Motion((2.0, -1.0)).places(slice(10, 11), (101, 101))
    >>> float(down[0, 20]), float(across[0, 20])
    (12.0, 19.0)
    """

    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    local: FloatArray | None = None

    def __post_init__(self) -> None:
        if not np.isfinite([*self.shift, self.angle]).all():
            raise InputError(f"a motion of {self.shift} pixels and {self.angle} radians, expected finite numbers")
        if self.local is not None:
            shape = self.local.shape
            if len(shape) != 3 or min(shape[:2]) < 2 or shape[2] != 2 or not np.isfinite(self.local).all():
                raise InputError(f"local shifts of shape {shape}, expected (2 or more, 2 or more, 2) and finite numbers")

    def places(self, rows: slice, shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """The place in the other frame of every pixel in some rows of the reference: (down, across), float32 (rows, W) each.

        rows: rows of the reference, a step of one.
        shape: (H, W) of the frames. Places may lie outside.
        """
        first, last, _ = rows.indices(shape[0])
        y, x = np.arange(first, last, dtype=np.float64)[:, None], np.arange(shape[1], dtype=np.float64)
        turn, start = self.affine(shape)
        down = turn[0, 0] * y + (turn[0, 1] * x + start[0])
        across = turn[1, 0] * y + (turn[1, 1] * x + start[1])
        if self.local is not None:
            local = _on_grid(self.local, y[:, 0], x, shape)
            down += local[..., 0]
            across += local[..., 1]
        return down.astype(np.float32), across.astype(np.float32)

    def back(self, y: FloatArray, x: FloatArray, shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """The places in the reference of points (y, x) of the other frame, float32 arrays of the same shape.

        shape: (H, W) of the frames. Points and places may lie outside.
        """
        turn, start = self.affine(shape)
        down, across = y - start[0], x - start[1]
        there = turn[0, 0] * down + turn[1, 0] * across, turn[0, 1] * down + turn[1, 1] * across
        for _ in range(ROUNDS):
            if self.local is None:
                break
            local = _at(self.local, *there, shape)
            down, across = y - start[0] - local[0], x - start[1] - local[1]
            there = turn[0, 0] * down + turn[1, 0] * across, turn[0, 1] * down + turn[1, 1] * across
        return there[0].astype(np.float32), there[1].astype(np.float32)

    @property
    def none(self) -> bool:
        """Whether nothing has moved."""
        return self.shift == (0, 0) and self.angle == 0 and self.local is None

    def times(self, factor: float) -> "Motion":
        """The same motion for a frame with `factor` times as many pixels a side."""
        local = None if self.local is None else self.local * np.float32(factor)
        return Motion((self.shift[0] * factor, self.shift[1] * factor), self.angle, local)

    def affine(self, shape: tuple[int, int]) -> tuple[DoubleArray, DoubleArray]:
        """(turn (2, 2), start (2,)): without local shifts the pixel p = (row, column) lies at turn @ p + start. shape: (H, W)."""
        turn = np.array([[cos(self.angle), -sin(self.angle)], [sin(self.angle), cos(self.angle)]])
        centre = (np.array(shape) - 1) / 2
        return turn, centre + self.shift - turn @ centre


def _on_grid(local: FloatArray, y: DoubleArray, x: DoubleArray, shape: tuple[int, int]) -> FloatArray:
    """Local shifts at rows y and columns x: (rows, columns, 2)."""
    top, below = _between(y, shape[0], local.shape[0])
    left, beside = _between(x, shape[1], local.shape[1])
    row, column = below[:, None, None], beside[:, None]
    lines = local[top] * (_ONE - row) + local[top + 1] * row
    return lines[:, left] * (_ONE - column) + lines[:, left + 1] * column


def _at(local: FloatArray, y: FloatArray, x: FloatArray, shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Local shifts at points, (down, across)."""
    top, below = _between(y, shape[0], local.shape[0])
    left, beside = _between(x, shape[1], local.shape[1])
    first, line = top * local.shape[1] + left, local.shape[1]
    down, across = (
        (flat[first] * (_ONE - beside) + flat[first + 1] * beside) * (_ONE - below)
        + (flat[first + line] * (_ONE - beside) + flat[first + line + 1] * beside) * below
        for flat in (local[..., 0].ravel(), local[..., 1].ravel())
    )
    return down, across


def _between(places: FloatArray | DoubleArray, size: int, nodes: int) -> tuple[IndexArray, FloatArray]:
    """The node before each place along a side of `size` pixels, and the share of the way to the next. Outside: the last node."""
    at = np.clip(places * ((nodes - 1) / max(size - 1, 1)), 0, nodes - 1)
    before = np.minimum(at.astype(np.intp), nodes - 2)
    return before, (at - before).astype(np.float32)
