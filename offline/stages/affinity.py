"""How much each pixel belongs to each block: harmonic fields on a graph that luminance edges cut (section 3.3, Eqs. 11-13).

There is one field per parity class of blocks (even or odd block row and column): blocks of the class are pinned to 1, all others
to 0. The four blocks at the corners of a patch belong to four different classes, so the four fields hold every map that the patch
needs. They sum to one at every pixel, so only three are solved (errata: "three maps out of every four").

The fields are those of the whole frame, solved region by region (`solve_regions`). A region is a core of patches and a halo around
it; cores form a grid that starts with the first patch. What lies beyond the halo changes the core by less than the solver's
tolerance does.

Transmission of luminance edges: exp(-e) of Eqs. 12-13, horizontal and vertical, for every pixel of a window.

The weight between neighbours n and n' is exp(-max(e[n], e[n'])), the lesser of their two transmissions. So weights are minima, and
an exponential is computed once per pixel and direction, not once per pair.

Harmonic fields on the graph of neighbouring pixels (Eqs. 11-13): conjugate gradients, region by region, three fields together.

A region is a core of patches and a halo of patches around it, cut where the domain ends. Pixels beyond the halo are ignored: blocks
pin the fields at every corner of every patch, so influence falls about tenfold with each patch it has to cross.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from shared.arrays import BoolArray, FloatArray, IndexArray
from shared.block_grid import BlockGrid
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..numerics.arrays import Bools1, Bools2, Doubles1, Floats1, Floats2, Floats3, Ints1, Pair, Scalar
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.conjugate import APPLIED, DIRECTION, MARGIN, RESIDUAL, SOLVED, around, conjugate_gradients
from ..numerics.functions import exponential, unset, zeros
from ..numerics.gaussian import TRUNCATE
from ..numerics.lanes import WIDTH, Lanes, greater, lesser, load, quotient, square_root, store, total
from ..numerics.solvers import report
from ..stage import Between, Count, Range, StageSettings
from ..tiling import HALO, core_patches, domain_places, patches_of

_SCALES = Range(lambda value: min(value, default=0) > 0, "one or more positive scales")


@dataclass(frozen=True)
class AffinitySettings(StageSettings):
    """Affinity maps, Eqs. 11-13.

    scales: standard deviations of the derivative filters, pixels (the paper gives none: errata).
    tolerance, iterations: of conjugate gradients, residual relative to the right-hand side, 0 to 1, and largest number.
    """

    scales: Annotated[tuple[float, ...], _SCALES] = (0.5, 1.0)
    tolerance: Between = 1e-3
    iterations: Count = 20_000  # photographs take 120 at most; pages without noise, where blocks differ by rounding, took 1056


def solve_affinities(
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: AffinitySettings,
    rows: tuple[int, int] | None = None,
    progress: Progress = SILENT,
) -> FloatArray:
    """alpha[p, q, n] in 0..1, float32 (2, 2, rows, domain columns): the field of the blocks with row parity p, column parity q.

    The domain is the frame mirrored out to whole patches (`BlockGrid`).

    luminance: (H, W), the whole frame.
    rows: first and end of the frame's rows whose patches are solved; they begin and end where cores do (`tiling.bands`), or where
        the frame does. None = all.
    Raises ConvergenceError when conjugate gradients do not reach the tolerance.
    """
    grid = pattern.grid((luminance.shape[0], luminance.shape[1]))
    period, across = grid.period, grid.patches[1]
    core = core_patches(period)
    filters = derivative_filters(settings.scales)
    places = domain_places(grid, filters[0].shape[1] - 1)
    pins = _pins(pattern, grid, (core[1] + 2 * HALO) * period)
    first, end = patches_of(grid, rows or (0, len(luminance)))
    fields = np.empty((CLASSES, (end - first) * period, across * period), np.float32)
    regions = -(-(end - first) // core[0]) * -(-across // core[1])
    residuals, used = np.empty(regions), np.empty(regions, np.intp)
    patches, limits = (first, end, across), (settings.tolerance, settings.iterations)
    solve_regions(luminance, places, patches, period, core, HALO, pins, filters, limits, fields, residuals, used)
    report(progress, "affinity", used, residuals, settings.tolerance)
    return fields.reshape(2, 2, *fields.shape[1:])


def derivative_filters(scales: tuple[float, ...]) -> tuple[FloatArray, FloatArray, IndexArray]:
    """A Gaussian and its slope at distances 0, 1, ... pixels, one row per scale, and the radius at which each ends.

    scales: standard deviations, pixels. Returns float32 (scales, reach + 1) twice, and (scales,).
    """
    radii = np.array([int(TRUNCATE * scale + 0.5) for scale in scales])
    distance = np.arange(radii.max() + 1)
    smooth = np.array(
        [np.exp(-(distance**2) / (2 * scale**2)) * (distance <= radius) for scale, radius in zip(scales, radii, strict=True)]
    )
    smooth /= smooth[:, :1] + 2 * smooth[:, 1:].sum(axis=1, keepdims=True)
    slope = smooth * distance / np.square(scales)[:, None]
    return smooth.astype(np.float32), slope.astype(np.float32), radii


def _pins(pattern: CfaPattern, grid: BlockGrid, columns: int) -> FloatArray:
    """The pinned values of three classes, and where any pin is, as `solve_regions` takes them."""
    (above, _), (left, _) = grid.padding
    shape = 2 * grid.period, 4 * grid.period + columns + 3 * WIDTH
    pinned = pattern.filter_map(shape, first=(-above, -left)) < len(pattern.channels)
    down, across = ((np.arange(size) + block // 2) // grid.period % 2 for size, block in zip(shape, grid.block_shape, strict=True))
    parity = 2 * down[:, None] + across
    classes: BoolArray = pinned & (parity == np.arange(CLASSES)[:, None, None])
    classes[-1] = pinned
    return classes.astype(np.float32)


Filters = tuple[Floats2, Floats2, Ints1]
Filter = tuple[Floats1, Floats1, int]


@kernel
def transmission(light: Floats2, period: int, filters: Filters, through: Floats3) -> None:
    """Compute exp(-e_h) and exp(-e_v) of a window of whole patches. A patch without gradients has a transmission of 1.

    light: luminance of the window, with `reach` more pixels on every side and 3 WIDTH columns of slack at the right.
    period: K, rows and columns of a patch.
    filters: (smooth, slope, radii), (scales, reach + 1) twice, a Gaussian and its slope at distances 0, 1, ..., and (scales,), the
        radius at which each ends.
    through: (2, rows + 2, WIDTH + columns + 2 WIDTH), written from row 1, column WIDTH on.
    """
    smooth, slope, radii = filters
    reach = smooth.shape[1] - 1
    rows, columns = light.shape[0] - 2 * reach, light.shape[1] - 2 * reach - 3 * WIDTH
    width = columns + WIDTH
    energy, relative = zeros(2, period, width), zeros(2, width)
    smoothed, sloped = zeros(light.shape[1]), zeros(light.shape[1])
    for top in range(0, rows, period):
        energy[:] = _ZERO
        for row in range(period):
            for scale in range(len(radii)):
                pair = smooth[scale], slope[scale], radii[scale]
                _filter_down(light, top + row + reach, columns + 2 * reach, pair, smoothed, sloped)
                _add_energy(smoothed, sloped, columns, reach, pair, energy, row)
        _over_mean(energy, columns, period, relative)
        for row in range(period):
            for axis in range(2):
                for column in range(0, columns, WIDTH):
                    e = load(energy, (axis, row, column)) * load(relative, (axis, column))
                    store(through, (axis, top + row + 1, column + WIDTH), exponential(e))


@kernel
def _filter_down(light: Floats2, row: int, columns: int, pair: Filter, smoothed: Floats1, sloped: Floats1) -> None:
    """Apply the vertical halves of both filters to one row.

    The slope is a sum of differences of symmetric pairs, so that flat input gives exactly 0.
    """
    smooth, slope, radius = pair
    for column in range(0, columns, WIDTH):
        sum_ = smooth[0] * load(light, (row, column))
        difference = _ZERO * load(light, (row, column))
        for step in range(1, radius + 1):
            above, below = load(light, (row - step, column)), load(light, (row + step, column))
            sum_ += smooth[step] * (above + below)
            difference += slope[step] * (below - above)
        store(smoothed, column, sum_)
        store(sloped, column, difference)


@kernel
def _add_energy(smoothed: Floats1, sloped: Floats1, columns: int, reach: int, pair: Filter, energy: Floats3, row: int) -> None:
    """Apply the horizontal halves: add |G_hs * l|^2 to plane 0 of `energy`, |G_vs * l|^2 to plane 1."""
    smooth, slope, radius = pair
    for column in range(0, columns, WIDTH):
        across = _ZERO * load(smoothed, column)
        down = smooth[0] * load(sloped, column + reach)
        for step in range(1, radius + 1):
            across += slope[step] * (load(smoothed, column + reach + step) - load(smoothed, column + reach - step))
            down += smooth[step] * (load(sloped, column + reach + step) + load(sloped, column + reach - step))
        store(energy, (0, row, column), load(energy, (0, row, column)) + across * across)
        store(energy, (1, row, column), load(energy, (1, row, column)) + down * down)


@kernel
def _over_mean(energy: Floats3, columns: int, period: int, relative: Floats2) -> None:
    """Write -1 / (mean energy of the patch) to all columns of each patch in a row of patches (errata: the mean, not the sum).

    Two patches at a time, both axes: each sum has to wait for its last element, four are as fast as one.
    """
    for left in range(0, columns, 2 * period):
        other = min(left + period, columns - period)  # if their number is odd, the last one twice
        a = b = c = d = _ZERO
        for row in range(period):
            for step in range(period):
                a += energy[0, row, left + step]
                b += energy[1, row, left + step]
                c += energy[0, row, other + step]
                d += energy[1, row, other + step]
        for step in range(period):
            relative[0, left + step], relative[1, left + step] = _over(a, period), _over(b, period)
            relative[0, other + step], relative[1, other + step] = _over(c, period), _over(d, period)


@kernel
def _over(total: Scalar, period: int) -> Scalar:
    """-1 over the mean of a patch whose sum is `total`; 0 without energy."""
    return np.float32(-period * period) / total if total > _ZERO else _ZERO


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
