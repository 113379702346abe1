"""What two planes say about how one lies against the other: sums of gradients and differences over tiles."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray

from .compile import kernel, parallel_kernel, prange
from .lanes import Scalar

Taps = tuple[float, float, float, float]

SUMS = 14
"""How many sums a tile has: 1, gy, gx, gy gy, gy gx, gx gx, e, gy e, gx e, e e, r, f, r r, r f, in this order."""


@parallel_kernel("f4[:, ::1], f4[:, ::1], i8[::1], i8[::1], (f8, f8, f8, f8), f8[:, :, ::1], f8, f8[:, :, ::1]")
def displacement_sums(
    reference: FloatArray,
    frame: FloatArray,
    rows: IndexArray,
    columns: IndexArray,
    turn: tuple[float, float, float, float],
    starts: DoubleArray,
    gain: float,
    sums: DoubleArray,
) -> None:
    """Compare the pixels of tiles with the places where a motion says that they lie in another frame.

    r is the reference, g = (gy, gx) its gradient, f the frame at the place divided by `gain`, and e = f - r.

    reference, frame: (H, W), smooth enough for bicubic interpolation. Pixels that are NaN, or have a NaN around them, do not count.
    rows, columns: where tiles begin, and the end of the last: (tile rows + 1,) and (tile columns + 1,).
    turn: (yy, yx, xy, xx): pixel (y, x) lies at (yy y + yx x, xy y + xx x) + the start of its tile.
    starts: (tile rows, tile columns, 2).
    gain: how many times as bright the frame is.
    sums: (tile rows, tile columns, SUMS), written; float64.
    """
    (height, width), across = frame.shape, len(columns) - 1
    yy, yx, xy, xx = turn
    part = 1.0 / gain
    for tile in prange((len(rows) - 1) * across):
        row, column = tile // across, tile % across
        total = np.zeros(SUMS)
        for y in range(max(rows[row], 1), min(rows[row + 1], reference.shape[0] - 1)):
            down, beside = yy * y + starts[row, column, 0], xy * y + starts[row, column, 1]
            for x in range(max(columns[column], 1), min(columns[column + 1], reference.shape[1] - 1)):
                to_y, to_x = down + yx * x, beside + xx * x
                if not (1.0 <= to_y < height - 2.0 and 1.0 <= to_x < width - 2.0):
                    continue
                seen = _between(frame, to_y, to_x) * part
                here = reference[y, x]
                steep_y = 0.5 * (reference[y + 1, x] - reference[y - 1, x])
                steep_x = 0.5 * (reference[y, x + 1] - reference[y, x - 1])
                error = seen - here
                if np.isnan(error + steep_y + steep_x):
                    continue
                total[0] += 1.0
                total[1] += steep_y
                total[2] += steep_x
                total[3] += steep_y * steep_y
                total[4] += steep_y * steep_x
                total[5] += steep_x * steep_x
                total[6] += error
                total[7] += steep_y * error
                total[8] += steep_x * error
                total[9] += error * error
                total[10] += here
                total[11] += seen
                total[12] += here * here
                total[13] += here * seen
        for each in range(SUMS):
            sums[row, column, each] = total[each]


@kernel
def _between(plane: FloatArray, y: float, x: float) -> Scalar:
    """Bicubic interpolation (Keys 1981, a = -1/2) at a place at least one pixel inside the plane."""
    top, left = int(y), int(x)
    along, down = _taps(x - left), _taps(y - top)
    before, after = _line(plane, top - 1, left, along), _line(plane, top + 2, left, along)
    return (
        down[0] * before + down[1] * _line(plane, top, left, along) + down[2] * _line(plane, top + 1, left, along) + down[3] * after
    )


@kernel
def _line(plane: FloatArray, y: int, x: int, taps: Taps) -> Scalar:
    light: Scalar = taps[0] * plane[y, x - 1] + taps[1] * plane[y, x] + taps[2] * plane[y, x + 1] + taps[3] * plane[y, x + 2]
    return light


@kernel
def _taps(t: float) -> Taps:
    """Weights of four neighbours for a place 0 <= t < 1 after the second."""
    square, cube = t * t, t * t * t
    return (
        0.5 * (2.0 * square - cube - t),
        0.5 * (3.0 * cube - 5.0 * square + 2.0),
        0.5 * (4.0 * square - 3.0 * cube + t),
        0.5 * (cube - square),
    )
