"""Motion of one frame of a hand-held series against another: a shift, a rotation, and local shifts (parallax)."""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError


@dataclass(frozen=True, eq=False)
class Motion:
    """Place of the points of the reference in another frame of the same size.

    The point (centre + (v, u)), v down and u across, of the reference lies in the other frame at

        centre + shift + (v cos(angle) - u sin(angle), v sin(angle) + u cos(angle)) + its local shift

    where centre is ((H - 1) / 2, (W - 1) / 2). `offline.burst.in_frame` and `in_reference` compute it and its inverse.

    shift: (down, across), pixels.
    angle: radians; positive turns the picture counter-clockwise on a screen.
    local: (node rows, node columns, 2), pixels (down, across), two or more nodes along each side; None: none. The nodes are a
        regular grid, the outermost on the outermost pixels of the frame; shifts are bilinear between them.

    Raises InputError for figures that are not finite, and for another shape of `local`.

    >>> from offline.burst import Motion
    >>> turn, start = Motion((2.0, -1.0)).affine((101, 101))
    >>> (turn @ (10, 20) + start).tolist()
    [12.0, 19.0]
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

    @property
    def none(self) -> bool:
        """True if nothing has moved."""
        return self.shift == (0, 0) and self.angle == 0 and self.local is None

    def times(self, factor: float) -> "Motion":
        """Return the same motion for a frame with `factor` times as many pixels a side."""
        local = None if self.local is None else self.local * np.float32(factor)
        return Motion((self.shift[0] * factor, self.shift[1] * factor), self.angle, local)

    def affine(self, shape: tuple[int, ...]) -> tuple[DoubleArray, DoubleArray]:
        """(turn (2, 2), start (2,)): without local shifts the pixel p = (row, column) lies at turn @ p + start. shape: (H, W)."""
        turn = np.array([[cos(self.angle), -sin(self.angle)], [sin(self.angle), cos(self.angle)]])
        centre = (np.array(shape) - 1) / 2
        return turn, centre + self.shift - turn @ centre
