"""Sums of gradients and differences over tiles of two planes: the displacement of one against the other follows from them."""

import numpy as np

from .arrays import Doubles1, Doubles3, Floats2, Ints1, Pair, Scalar
from .compile import Pieces, kernel, parallel_kernel
from .interpolation import interpolated

_HALF, _ONE = np.float32(0.5), np.float32(1)

SUMS = 14
"""How many sums a tile has: 1, gy, gx, gy gy, gy gx, gx gx, e, gy e, gx e, e e, r, f, r r, r f, in this order."""


@parallel_kernel(pieces=lambda *given: given[-1].shape[0] * given[-1].shape[1])
def displacement_sums(
    pieces: Pieces,
    reference: Floats2,
    frame: Floats2,
    rows: Ints1,
    columns: Ints1,
    turn: tuple[float, float, float, float],
    starts: Doubles3,
    gain: float,
    sums: Doubles3,
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
    across, part = len(columns) - 1, np.float32(1.0 / gain)
    for tile in range(pieces[0], pieces[1]):
        row, column = tile // across, tile % across
        place = starts[row, column, 0], starts[row, column, 1]
        total = np.zeros(SUMS)
        for y in range(max(rows[row], 1), min(rows[row + 1], reference.shape[0] - 1)):
            first = max(columns[column], 1), min(columns[column + 1], reference.shape[1] - 1)
            _add_row(reference, frame, y, first, turn, place, part, total)
        for each in range(SUMS):
            sums[row, column, each] = total[each]


@kernel
def _add_row(
    reference: Floats2,
    frame: Floats2,
    y: int,
    columns: Pair,
    turn: tuple[float, float, float, float],
    start: tuple[float, float],
    part: Scalar,
    total: Doubles1,
) -> None:
    """Add the pixels of a row of a tile, columns[0] to columns[1], to its sums."""
    height, width = frame.shape
    down, beside = turn[0] * y + start[0], turn[2] * y + start[1]
    n = gy = gx = gyy = gyx = gxx = se = gye = gxe = see = sr = sf = srr = srf = np.float32(0)
    for x in range(columns[0], columns[1]):
        to_y, to_x = down + turn[1] * x, beside + turn[3] * x
        if not (1.0 <= to_y < height - 2.0 and 1.0 <= to_x < width - 2.0):
            continue
        f = part * interpolated(frame, to_y, to_x)
        r = reference[y, x]
        steep_y = _HALF * (reference[y + 1, x] - reference[y - 1, x])
        steep_x = _HALF * (reference[y, x + 1] - reference[y, x - 1])
        e = f - r
        if np.isnan(e + steep_y + steep_x):
            continue
        n += _ONE
        gy += steep_y
        gx += steep_x
        gyy += steep_y * steep_y
        gyx += steep_y * steep_x
        gxx += steep_x * steep_x
        se += e
        gye += steep_y * e
        gxe += steep_x * e
        see += e * e
        sr += r
        sf += f
        srr += r * r
        srf += r * f
    for each, value in enumerate((n, gy, gx, gyy, gyx, gxx, se, gye, gxe, see, sr, sf, srr, srf)):
        total[each] += value
