"""Where the points of one frame of a burst lie in another: `shared.motion.Motion` inside kernels."""

import numpy as np

from shared.motion import ROUNDS

from .arrays import Area, Doubles2, Doubles3, Floats4
from .compile import kernel

Motions = tuple[Doubles3, Doubles2, Floats4]
"""(turns, starts, shifts) of F frames, (F, 2, 2), (F, 2), (F, node rows, node columns, 2), as `Motion` has them."""


@kernel
def there(motions: Motions, frame: int, y: float, x: float, shape: tuple[int, int, int]) -> tuple[float, float]:
    """Where a point of the reference lies in a frame."""
    turns, starts, shifts = motions
    down, across = _shift(shifts, frame, y, x, shape)
    return (
        turns[frame, 0, 0] * y + turns[frame, 0, 1] * x + starts[frame, 0] + down,
        turns[frame, 1, 0] * y + turns[frame, 1, 1] * x + starts[frame, 1] + across,
    )


@kernel
def back(motions: Motions, frame: int, y: float, x: float, shape: tuple[int, int, int]) -> tuple[float, float]:
    """Where a point of a frame lies in the reference."""
    turns, starts, shifts = motions
    down, across = y - starts[frame, 0], x - starts[frame, 1]
    at_y = turns[frame, 0, 0] * down + turns[frame, 1, 0] * across
    at_x = turns[frame, 0, 1] * down + turns[frame, 1, 1] * across
    if shifts.shape[1] < 2:
        return at_y, at_x
    for _ in range(ROUNDS):
        local = _shift(shifts, frame, at_y, at_x, shape)
        at_y = turns[frame, 0, 0] * (down - local[0]) + turns[frame, 1, 0] * (across - local[1])
        at_x = turns[frame, 0, 1] * (down - local[0]) + turns[frame, 1, 1] * (across - local[1])
    return at_y, at_x


@kernel
def _shift(shifts: Floats4, frame: int, y: float, x: float, shape: tuple[int, int, int]) -> tuple[float, float]:
    """The local shift at a point of the reference."""
    rows, columns = shifts.shape[1], shifts.shape[2]
    if rows < 2:
        return 0.0, 0.0
    at_y = min(max(y * (rows - 1) / max(shape[1] - 1, 1), 0.0), rows - 1.0)
    at_x = min(max(x * (columns - 1) / max(shape[2] - 1, 1), 0.0), columns - 1.0)
    top, left = min(int(at_y), rows - 2), min(int(at_x), columns - 2)
    down, across = at_y - top, at_x - left
    a, b, c, d = (1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across
    return (
        a * shifts[frame, top, left, 0] + b * shifts[frame, top, left + 1, 0]
        + c * shifts[frame, top + 1, left, 0] + d * shifts[frame, top + 1, left + 1, 0],
        a * shifts[frame, top, left, 1] + b * shifts[frame, top, left + 1, 1]
        + c * shifts[frame, top + 1, left, 1] + d * shifts[frame, top + 1, left + 1, 1],
    )  # fmt: skip


@kernel
def bounds(motions: Motions, frame: int, area: Area, shape: tuple[int, int, int]) -> Area:
    """First and end row, first and end column, of a frame's pixels that may lie in an area of the reference."""
    low, high = np.array([1e9, 1e9]), np.array([-1e9, -1e9])
    steps = 8 if motions[2].shape[1] > 1 else 1
    for i in range(steps + 1):
        for j in range(steps + 1):
            if 0 < i < steps and 0 < j < steps:
                continue
            y, x = area[0] - 1 + (area[1] - area[0] + 1) * i / steps, area[2] - 1 + (area[3] - area[2] + 1) * j / steps
            at = there(motions, frame, y, x, shape)
            for axis in range(2):
                low[axis], high[axis] = min(low[axis], at[axis]), max(high[axis], at[axis])
    return (
        max(int(np.floor(low[0])) - 1, 0), min(int(np.ceil(high[0])) + 2, shape[1]),
        max(int(np.floor(low[1])) - 1, 0), min(int(np.ceil(high[1])) + 2, shape[2]),
    )  # fmt: skip
