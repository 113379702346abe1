"""Harmonic fields on the graph of neighbouring pixels (Eqs. 11-13): conjugate gradients, region by region, three fields together.

A region is a core of patches and a halo of patches around it, cut where the domain ends. Pixels beyond the halo are ignored: blocks
pin the fields at every corner of every patch, so influence falls about tenfold with each patch it has to cross.
"""

import numpy as np

from .arrays import Bools1, Bools2, Doubles1, Floats1, Floats2, Floats3, Ints1, Pair
from .compile import Pieces, kernel, parallel_kernel
from .conjugate import APPLIED, DIRECTION, MARGIN, RESIDUAL, SOLVED, around, conjugate_gradients
from .edges import Filters, transmission
from .functions import unset, zeros
from .lanes import WIDTH, Lanes, greater, lesser, load, quotient, square_root, store, total

CLASSES = 4
"""Parities of block row and column: the blocks around a pixel are one of each."""
_ZERO, _ONE, _QUARTER = np.float32(0), np.float32(1), np.float32(0.25)
_ONES = (_ONE,) * 8
_LEAST = np.float32(1e-37)
_PLANES = 4 + 1 + 2 + 4 * SOLVED


@parallel_kernel()
def solve_regions(
    pieces: Pieces,
    luminance: Floats2,
    places: tuple[Ints1, Ints1],
    patches: tuple[int, int, int],
    period: int,
    core: Pair,
    halo: int,
    pins: Floats3,
    filters: Filters,
    limits: tuple[float, int],
    fields: Floats3,
    residuals: Doubles1,
    used: Ints1,
) -> None:
    """Solve the fields of some rows of patches.

    luminance: (H, W), scene units.
    places: the frame's row at each row of the domain, and its column at each column; the filters' reach more at both ends.
    patches: (first row, end row, columns) of the patches. Both rows are multiples of `core[0]`, unless the domain ends there.
    period: K, pixels.
    core, halo: patches of a core, (down, across), and around it.
    pins: (4, 2 period, 4 period + a region's columns + 3 WIDTH), from the domain's corner on, repeating in both directions: 1 at
        the pixels pinned to one in field 0, 1, 2, and at all pinned pixels.
    filters: (smooth, slope, radii) as `transmission` takes them.
    limits: (tolerance, iterations) of conjugate gradients: norm of the residual relative to that of the right-hand side, both
        scaled, and the most iterations.
    fields: (4, pixel rows, domain columns), written.
    residuals: (regions,), written: the relative residual of the worst field of each region.
    used: (regions,), written: the iterations that each region used.
    """
    (rows, columns), (first, end, across), (tolerance, iterations) = places, patches, limits
    reach = filters[0].shape[1] - 1
    height = len(rows) - 2 * reach
    along = (across + core[1] - 1) // core[1]
    tallest, widest = (core[0] + 2 * halo) * period, (core[1] + 2 * halo) * period
    # Memory is taken once: fresh pages for every region would cost as much as solving it.
    memory = unset(_PLANES * (tallest + 2) * _width(widest))
    pinned = _pinned(pins)
    window = unset((tallest + 2 * reach) * (widest + 2 * reach + 3 * WIDTH))
    for region in range(pieces[0], pieces[1]):
        top, left = first + region // along * core[0], region % along * core[1]
        bottom, right = min(top + core[0], end), min(left + core[1], across)
        above, before = max(top - halo, 0), max(left - halo, 0)
        below, after = min(bottom + halo, height // period), min(right + halo, across)
        size = (below - above) * period, (after - before) * period
        place = above * period, before * period
        light = window[: (size[0] + 2 * reach) * (size[1] + 2 * reach + 3 * WIDTH)].reshape(size[0] + 2 * reach, -1)
        for row in range(size[0] + 2 * reach):
            _gather(luminance[rows[place[0] + row]], columns[place[1] : place[1] + size[1] + 2 * reach], light[row])
        width = _width(size[1])
        planes = memory[: _PLANES * (size[0] + 2) * width].reshape(_PLANES, size[0] + 2, width)
        weights, scale, through, unknowns = planes[:4], planes[4], planes[5:7], planes[7:]
        for framed in (planes[:7], unknowns[DIRECTION:APPLIED]):
            _frame(framed, size)
        transmission(light, period, filters, through)
        norm = _start(through, place, size, pins, pinned, weights, scale, unknowns)
        residuals[region], used[region] = conjugate_gradients(weights, size, unknowns, norm, tolerance, iterations)
        inner = (top - above) * period, (left - before) * period
        core_size = (bottom - top) * period, (right - left) * period
        _finish(unknowns, scale, pins, place, inner, core_size, fields, ((top - first) * period, left * period))


@kernel
def _width(columns: int) -> int:
    """Columns of the planes of a region that has `columns` of its own."""
    return MARGIN + (columns + WIDTH - 1) // WIDTH * WIDTH + MARGIN


@kernel
def _gather(source: Floats1, places: Ints1, row: Floats1) -> None:
    """Store the elements of a row of the frame that `places` names."""
    for column in range(0, len(places), WIDTH):
        first, end = places[column], min(column + WIDTH, len(places))
        if places[end - 1] - first == WIDTH - 1:  # not mirrored
            store(row, column, load(source, first))
        else:
            for place in range(column, end):
                row[place] = source[places[place]]


@kernel
def _frame(planes: Floats3, size: Pair) -> None:
    """Surround the rows and columns of a region by zeros."""
    width = planes.shape[2]
    for plane in range(len(planes)):
        for column in range(width):
            planes[plane, 0, column] = planes[plane, size[0] + 1, column] = _ZERO
        for row in range(1, size[0] + 1):
            for step in range(WIDTH):
                planes[plane, row, step] = planes[plane, row, MARGIN + size[1] + step] = _ZERO
                planes[plane, row, width - WIDTH + step] = _ZERO


@kernel
def _pinned(pins: Floats3) -> Bools2:
    """Whether any pixel of a row of the region, or of the rows around it, is pinned: per plane and row of `pins`."""
    planes, rows, columns = pins.shape
    found = np.zeros((planes, rows), np.bool_)
    for plane in range(planes):
        for row in range(rows):
            for column in range(columns):
                if pins[plane, row, column] > 0:
                    for near in range(-1, 2):
                        found[plane, (row + near) % rows] = True
                    break
    return found


@kernel
def _start(
    through: Floats3, place: Pair, size: Pair, pins: Floats3, pinned: Bools2, weights: Floats3, scale: Floats2, unknowns: Floats3
) -> float:
    """Set up the system: weights, scaling and the residuals of the start. All planes are a region in a frame of zeros.

    The start is the same in all four fields, a quarter at every free pixel: a pixel that edges cut off from every block is then
    shared by all, not left to the fourth. Returns the largest squared norm of a right-hand side.

    through: (2, rows + 2, width), from `transmission`.
    weights: (4, rows + 2, width), written: c[n, n'] to the right, below, below right and below left, scaled.
    scale: (rows + 2, width), written: d^(-1/2), d the sum of c over all eight neighbours; 0 where pinned.
    unknowns: the residuals among them are written.
    """
    period2 = pins.shape[1]
    squares = zeros(SOLVED, WIDTH)
    for row in range(size[0] + 2):  # no neighbours past the end
        for column in range(MARGIN + size[1], through.shape[2]):
            through[0, row, column] = through[1, row, column] = _ZERO
    for row in range(1, size[0] + 2):
        if row <= size[0]:
            at = (place[0] + row - 1) % period2
            first = _phase(place, period2 // 2)
            _weigh(through, row, size[1], weights)
            _root(weights, row, size[1], pins[SOLVED, at, first:], scale)
            _pull(weights, scale, row, size[1], pins, pinned[:, at], (at, first), unknowns[RESIDUAL:DIRECTION], squares)
        if row > 1:  # both rows that need the weights as they were are done
            _scale(weights, scale, row - 1, size[1])
    return float(max(total(load(squares, (0, 0))), total(load(squares, (1, 0))), total(load(squares, (2, 0)))))


@kernel
def _weigh(through: Floats3, row: int, columns: int, weights: Floats3) -> None:
    """Compute the weights of Eq. 12 of one row."""
    for column in range(MARGIN, MARGIN + columns, WIDTH):
        h, v = load(through, (0, row, column)), load(through, (1, row, column))
        either = lesser(h, v)  # e is the greater of both directions' along a diagonal (errata)
        store(weights, (0, row, column), lesser(h, load(through, (0, row, column + 1))))
        store(weights, (1, row, column), lesser(v, load(through, (1, row + 1, column))))
        for side in range(2):
            other = row + 1, column + 1 - 2 * side
            there = lesser(load(through, (0, *other)), load(through, (1, *other)))
            store(weights, (2 + side, row, column), lesser(either, there))


@kernel
def _root(weights: Floats3, row: int, columns: int, pins: Floats1, scale: Floats2) -> None:
    """Compute the scaling of one row. pins: 1 at its pinned pixels."""
    for column in range(MARGIN, MARGIN + columns, WIDTH):
        degree = around(weights, row, column, _ONES)
        free = _ONE - load(pins, column - MARGIN)
        store(scale, (row, column), quotient(free, square_root(greater(degree, _LEAST))))
    for column in range(MARGIN + columns, scale.shape[1]):
        scale[row, column] = _ZERO


@kernel
def _scale(weights: Floats3, scale: Floats2, row: int, columns: int) -> None:
    """Scale the weights of one row."""
    for column in range(MARGIN, MARGIN + columns, WIDTH):
        here = load(scale, (row, column))
        # From left to right: both roots may be as large as 3e18, their product with a weight is at most one.
        store(weights, (0, row, column), load(weights, (0, row, column)) * here * load(scale, (row, column + 1)))
        store(weights, (1, row, column), load(weights, (1, row, column)) * here * load(scale, (row + 1, column)))
        store(weights, (2, row, column), load(weights, (2, row, column)) * here * load(scale, (row + 1, column + 1)))
        store(weights, (3, row, column), load(weights, (3, row, column)) * here * load(scale, (row + 1, column - 1)))


@kernel
def _phase(place: Pair, period: int) -> int:
    """The column of `pins` that belongs to a region's first column; there are further columns to its left."""
    return 2 * period + place[1] % (2 * period)


@kernel
def _pull(
    weights: Floats3,
    scale: Floats2,
    row: int,
    columns: int,
    pins: Floats3,
    pinned: Bools1,
    corner: Pair,
    residuals: Floats3,
    squares: Floats2,
) -> None:
    """Compute the residuals of one row, and add the squares of its right-hand sides to `squares`.

    pinned: planes of `pins` in which a pixel of the row has pinned neighbours. corner: row and column of `pins` at the row's first.
    """
    at, first = corner
    above, below = (at - 1) % pins.shape[1], (at + 1) % pins.shape[1]
    for column in range(MARGIN, MARGIN + columns, WIDTH):
        x, here = first + column - MARGIN, load(scale, (row, column))
        nothing = _ZERO * here
        every = _pulled(weights, row, column, pins, SOLVED, above, at, below, x) if pinned[SOLVED] else nothing
        for field in range(SOLVED):
            pulled = _pulled(weights, row, column, pins, field, above, at, below, x) if pinned[field] else nothing
            store(residuals, (field, row, column), here * (pulled - _QUARTER * every))
            side = here * pulled
            store(squares, (field, 0), load(squares, (field, 0)) + side * side)


@kernel
def _pulled(weights: Floats3, row: int, column: int, pins: Floats3, field: int, above: int, at: int, below: int, x: int) -> Lanes:
    """The sum over the pinned neighbours of c[n, n'] times their value: the right-hand side, before scaling."""
    near = (
        load(pins, (field, at, x + 1)),
        load(pins, (field, at, x - 1)),
        load(pins, (field, below, x)),
        load(pins, (field, above, x)),
        load(pins, (field, below, x + 1)),
        load(pins, (field, above, x - 1)),
        load(pins, (field, below, x - 1)),
        load(pins, (field, above, x + 1)),
    )
    return around(weights, row, column, near)


@kernel
def _finish(
    solution: Floats3, scale: Floats2, pins: Floats3, place: Pair, inner: Pair, size: Pair, fields: Floats3, corner: Pair
) -> None:
    """Write the four fields of a core: not below zero, and scaled to a sum of one, despite rounding and tolerance.

    inner, corner: the core's first row and column in the region, and in `fields`. size: rows and columns of the core.
    """
    period2 = pins.shape[1]
    phase = _phase(place, period2 // 2)
    first = MARGIN + inner[1]
    rows, columns = size
    whole = columns // WIDTH * WIDTH
    line = zeros(SOLVED + 1, columns + WIDTH)
    for row in range(rows):
        at = (place[0] + inner[0] + row) % period2
        for column in range(0, columns, WIDTH):
            x = phase + inner[1] + column
            here = load(scale, (inner[0] + row + 1, first + column))
            free = _QUARTER * (_ONE - load(pins, (SOLVED, at, x)))
            together = _ZERO * here
            for field in range(SOLVED):
                start = load(pins, (field, at, x)) + free
                value = greater(start + here * load(solution, (field, inner[0] + row + 1, first + column)), _ZERO)
                store(line, (field, column), value)
                together += value
            rest = greater(_ONE - together, _ZERO)
            share = quotient(_ONE, together + rest)
            store(line, (SOLVED, column), rest * share)
            for field in range(SOLVED):
                store(line, (field, column), load(line, (field, column)) * share)
        for field in range(SOLVED + 1):
            for column in range(0, whole, WIDTH):
                store(fields, (field, corner[0] + row, corner[1] + column), load(line, (field, column)))
            for column in range(whole, columns):  # beyond the core are the fields of another
                fields[field, corner[0] + row, corner[1] + column] = line[field, column]
