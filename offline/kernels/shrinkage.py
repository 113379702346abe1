"""One iteration of hole filling (Eqs. 3-5) for any pattern, over the whole plane, in strips; each row of a band is computed once.

The wavelet frame is tight (synthesis undoes analysis), so instead of synthesising what shrinkage leaves, the kernel synthesises
what shrinkage removes and subtracts it from the plane. Rows without a hole are not synthesised.
"""

import numpy as np

from .arrays import Area, Floats1, Floats2, Floats3, Pair, Scalar, Single
from .compile import Pieces, kernel, parallel_kernel
from .functions import mirrored, scaled_reciprocal_root, zeros
from .lanes import WIDTH, Lanes, lesser, load, store

REACH = 4
"""Radius in pixels of the area on which a new value depends: three for the taps, one for the 3 x 3 neighbourhood of Eq. 2."""
SLACK = REACH + 2 * WIDTH
"""Columns of the planes after the mirrored border, so that the last vector stays inside the array."""
_BANDS = 3  # horizontal, vertical, diagonal: what one level of a wavelet has besides the means
_STRIP = 64  # rows of a piece of work; chosen for speed


Planes = tuple[Floats2, Floats2, Floats2, Floats2]


@parallel_kernel(pieces=lambda plane, *_: -(-len(plane) // _STRIP))
def shrink_once(
    pieces: Pieces, plane: Floats2, result: Floats2, columns: int, holes: Floats2, taps: Floats2, threshold: Single
) -> None:
    """Shrink the coefficients of `plane` once, and write the new values of the holes to `result`.

    plane: (H, REACH + columns + REACH + SLACK), the frame with mirrored columns.
    result: same shape, equal to `plane` except in the holes; holes are written, mirrored ones too.
    columns: number of columns without the border.
    holes: (period, columns + SLACK), 1 at a hole and 0 elsewhere; the rows repeat.
    taps: (2, 4), low-pass and high-pass.
    threshold: scene units.
    """
    height = plane.shape[0]
    for strip in range(pieces[0], pieces[1]):
        _shrink_rows(
            plane, result, (strip * _STRIP, min(height, (strip + 1) * _STRIP)), columns, holes, taps, np.float32(threshold)
        )


@parallel_kernel(pieces=lambda planes, *_: len(planes))
def shrink_margins(
    pieces: Pieces,
    planes: Planes,
    results: Planes,
    columns: tuple[int, int, int, int],
    holes: Planes,
    taps: Floats2,
    thresholds: Floats1,
) -> None:
    """Run `shrink_once` on four planes of a few rows each, with one threshold after the other, from plane to result and back."""
    for each in range(pieces[0], pieces[1]):
        plane, result = planes[each], results[each]
        for threshold in thresholds:
            _shrink_rows(plane, result, (0, len(plane)), columns[each], holes[each], taps, threshold)
            plane, result = result, plane


@kernel
def _shrink_rows(
    plane: Floats2, result: Floats2, rows: Pair, columns: int, holes: Floats2, taps: Floats2, threshold: Scalar
) -> None:
    """Do what `shrink_once` does, for the rows from the first of `rows` to its end."""
    first, last = rows
    width = plane.shape[1]
    low, high = zeros(width), zeros(width)
    bands, removed = zeros(_BANDS, 3, width), zeros(_BANDS, 4, width)
    # Row r of the bands sees rows r - 4 .. r - 1 of the frame.
    for row in range(first, last + REACH + 1):
        _decompose(plane, row, columns, taps, low, high, bands)
        if row >= first + 2:
            _shrink(bands, row - 1, columns, threshold, low, removed)
        below = row - REACH - 1
        if below >= first and holes[below % len(holes), :columns].any():
            _synthesise(removed, below, columns, taps, low, high)
            for column in range(0, columns, WIDTH):
                change = load(holes, (below % len(holes), column)) * load(low, column)
                store(result, (below, column + REACH), load(plane, (below, column + REACH)) - change)
            mirror_columns(result[below], columns)


@kernel
def mirror_columns(row: Floats1, columns: int) -> None:
    """Set the REACH pixels on either side of a row of `columns` to their mirror images."""
    for step in range(1, REACH + 1):
        row[REACH - step] = row[REACH + mirrored(-step, columns)]
        row[REACH + columns - 1 + step] = row[REACH + mirrored(columns - 1 + step, columns)]


@kernel
def _decompose(plane: Floats2, row: int, columns: int, taps: Floats2, low: Floats1, high: Floats1, bands: Floats3) -> None:
    """Compute row `row` of the three high-pass bands, with four columns more than the frame, and slack for a vector."""
    r0, r1, r2, r3 = (
        mirrored(row - 4, len(plane)), mirrored(row - 3, len(plane)), mirrored(row - 2, len(plane)), mirrored(row - 1, len(plane))
    )  # fmt: skip
    l0, l1, l2, l3 = taps[0]
    h0, h1, h2, h3 = taps[1]
    for column in range(0, columns + 2 * REACH, WIDTH):
        p0, p1, p2, p3 = load(plane, (r0, column)), load(plane, (r1, column)), load(plane, (r2, column)), load(plane, (r3, column))
        store(low, column, l0 * p0 + l1 * p1 + l2 * p2 + l3 * p3)
        store(high, column, h0 * p0 + h1 * p1 + h2 * p2 + h3 * p3)
    place = row % 3
    for column in range(0, columns + REACH + 1, WIDTH):
        p0, p1, p2, p3 = load(low, column), load(low, column + 1), load(low, column + 2), load(low, column + 3)
        store(bands, (0, place, column), h0 * p0 + h1 * p1 + h2 * p2 + h3 * p3)
        p0, p1, p2, p3 = load(high, column), load(high, column + 1), load(high, column + 2), load(high, column + 3)
        store(bands, (1, place, column), l0 * p0 + l1 * p1 + l2 * p2 + l3 * p3)
        store(bands, (2, place, column), h0 * p0 + h1 * p1 + h2 * p2 + h3 * p3)


@kernel
def _shrink(bands: Floats3, row: int, columns: int, threshold: Scalar, squares: Floats1, removed: Floats3) -> None:
    """Compute what Eq. 5 removes from row `row` of the bands; the rows above and below must be there too."""
    for band in range(_BANDS):
        for column in range(0, columns + REACH + 1, WIDTH):
            b0, b1, b2 = load(bands, (band, 0, column)), load(bands, (band, 1, column)), load(bands, (band, 2, column))
            store(squares, column, b0 * b0 + b1 * b1 + b2 * b2)
        for column in range(0, columns + REACH, WIDTH):
            box = load(squares, column) + load(squares, column + 1) + load(squares, column + 2)
            part = lesser(_ONE, scaled_reciprocal_root(box, threshold))
            store(removed, (band, row % 4, column), load(bands, (band, row % 3, column + 1)) * part)


@kernel
def _synthesise(removed: Floats3, row: int, columns: int, taps: Floats2, low: Floats1, high: Floats1) -> None:
    """Synthesise row `row` of the frame from rows row + 1 .. row + 4 of the bands, into `low`; the taps are reversed."""
    rows = (row + 1) % 4, (row + 2) % 4, (row + 3) % 4, row % 4
    l3, l2, l1, l0 = taps[0]
    h3, h2, h1, h0 = taps[1]
    for column in range(0, columns + REACH, WIDTH):
        p0, p1, p2, p3 = _four(removed, 0, rows, column)
        across = l0 * p0 + l1 * p1 + l2 * p2 + l3 * p3
        p0, p1, p2, p3 = _four(removed, 2, rows, column)
        store(high, column, across + h0 * p0 + h1 * p1 + h2 * p2 + h3 * p3)
        p0, p1, p2, p3 = _four(removed, 1, rows, column)
        store(low, column, h0 * p0 + h1 * p1 + h2 * p2 + h3 * p3)
    for column in range(0, columns, WIDTH):
        p0, p1, p2, p3 = load(high, column), load(high, column + 1), load(high, column + 2), load(high, column + 3)
        across = h0 * p0 + h1 * p1 + h2 * p2 + h3 * p3
        p0, p1, p2, p3 = load(low, column), load(low, column + 1), load(low, column + 2), load(low, column + 3)
        store(low, column, across + l0 * p0 + l1 * p1 + l2 * p2 + l3 * p3)


@kernel
def _four(bands: Floats3, band: int, rows: Area, x: int) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """The coefficients of one band in four of its rows, from column x on."""
    a, b, c, d = rows
    return load(bands, (band, a, x)), load(bands, (band, b, x)), load(bands, (band, c, x)), load(bands, (band, d, x))
