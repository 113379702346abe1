"""Affinity of every pixel to the blocks around it (section 3.3, Eqs. 11-13): harmonic fields that
edges of luminance cut.

Edges, Eq. 13: e_h = sum_s |G_hs * l|^2, the energy of horizontal derivatives of luminance l at the
scales s, over its mean in the K x K patch (errata: the mean, not the sum); e_v alike, and e_d =
max(e_h, e_v) along diagonals (errata). Weights, Eq. 12: c[n, n'] = exp(-max(e[n], e[n'])), e that
of the direction from n to n'. Fields, Eq. 11: alpha minimises the sum over neighbours of c[n, n']
(alpha[n] - alpha[n'])^2, with alpha given at the blocks: at all other pixels alpha[n] is the mean
of its neighbours, weighted by c.

There is one field per parity class of blocks (even or odd block row and column): 1 at blocks of the
class, 0 at all others. The four blocks at the corners of a patch belong to four different classes,
so the four fields hold every map that the patch needs. They sum to one at every pixel, so only
three are solved (errata: "three maps out of every four").

The fields are those of the whole frame, solved in chunks of patches with a halo around them, cut
where the padded frame ends; chunks form a grid that starts with the first patch. Blocks hold the
fields at every corner of every patch, so influence falls about tenfold with each patch it has to
cross: what lies beyond the halo changes the chunk by less than the solver's tolerance.

Literally: tests/reference/affinity.py.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ...shared import BlockGrid, CfaPattern
from ...shared.arrays import BoolArray, FloatArray, Pair
from ..numerics import conjugate_gradients as solver
from ..numerics.arrays import Area, Doubles1, Floats1, Floats2, Floats3, Ints1
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.functions import chunk_at, chunk_count, exponential, zeros
from ..numerics.gaussian import TRUNCATE
from ..patches import HALO, chunk_patches, padded_rows, patches_of
from ..stage import Between, Count, Range, StageSettings

_SCALES = Range(
    lambda value: min(value, default=0) > 0 and max(value) <= 64,
    "one or more scales, each more than 0, 64 at most",
)
CLASSES = 4
"""Parities of block row and column: the blocks around a pixel are one of each."""
_SOLVED = CLASSES - 1


@dataclass(frozen=True)
class AffinitySettings(StageSettings):
    """Affinity maps, Eqs. 11-13.

    Attributes
    ----------
    scales : tuple[float, ...]
        Standard deviations of the derivative filters, pixels (the paper gives none: errata).
    tolerance, iterations : Between, Count
        Of conjugate gradients, residual relative to the right-hand side, 0 to 1, and largest
        number.
    """

    scales: Annotated[tuple[float, ...], _SCALES] = (0.5, 1.0)
    tolerance: Between = 1e-3
    # photographs take 120 at most; pages without noise, where blocks differ by rounding, took 1056
    iterations: Count = 20_000


class Filters(NamedTuple):
    """Gaussians and their slopes, (scales, reach + 1), at distances 0, 1, ... pixels; at 0 half of
    them, for each of two sides.
    """

    smooth: Floats2
    slope: Floats2


def solve_affinities(
    luminance: FloatArray, pattern: CfaPattern, settings: AffinitySettings, rows: Pair | None = None
) -> FloatArray:
    """alpha[p, q, n] in 0..1, float32 (2, 2, rows, columns) of the padded frame (`BlockGrid`): the
    field of the blocks with row parity p, column parity q.

    Parameters
    ----------
    luminance : FloatArray
        (H, W), the whole frame.
    rows : tuple[int, int] | None, optional
        First and end of the frame's rows whose patches are solved; they begin and end where chunks
        do (`patches.band_rows`), or where the frame does. None = all.

    Raises
    ------
    ConvergenceError
        When conjugate gradients do not reach the tolerance.
    """
    grid = pattern.grid((luminance.shape[0], luminance.shape[1]))
    period, (down, across) = grid.period, grid.patches
    size, filters = chunk_patches(period), derivative_filters(settings.scales)
    first, end = patches_of(grid, rows or (0, len(luminance)))
    above = max(first - HALO, 0) // 2 * 2  # even: there the pins repeat
    seen = above, min(end + HALO, down)
    patches = first - above, end - above  # counted from the first that is seen
    padded = padded_rows(luminance, grid, seen, filters.smooth.shape[1] - 1)
    count = chunk_count((end - first, across), size)
    residuals, used = np.empty(count), np.empty(count, np.intp)
    fields = np.empty((CLASSES, (end - first) * period, across * period), np.float32)
    limits = solver.Limits(settings.tolerance, settings.iterations)
    pins = _pins(pattern, grid, (size[1] + 2 * HALO) * period)
    solve_fields(padded, patches, size, pins, filters, limits, fields, residuals, used)
    solver.check_convergence("affinity", used, residuals, settings.tolerance)
    return fields.reshape(2, 2, *fields.shape[1:])


def derivative_filters(scales: tuple[float, ...]) -> Filters:
    """Gaussian filters at these scales, standard deviations in pixels."""
    distance = np.arange(int(TRUNCATE * max(scales) + 0.5) + 1)
    deviation = np.array(scales)[:, None]
    near = distance <= (TRUNCATE * deviation + 0.5).astype(int)
    smooth = np.exp(-(distance**2) / (2 * deviation**2)) * near
    smooth /= smooth[:, :1] + 2 * smooth[:, 1:].sum(axis=1, keepdims=True)
    smooth[:, 0] /= 2  # the middle counts on both sides
    return Filters(smooth.astype(np.float32), (smooth * distance / deviation**2).astype(np.float32))


def _pins(pattern: CfaPattern, grid: BlockGrid, columns: int) -> FloatArray:
    """Values at the blocks, from the padded frame's corner on, repeating in both directions: (4, 2
    K, 2 K + a chunk's columns).

    1 at the blocks of class 0, 1 and 2, and last at all blocks.
    """
    (above, _), (left, _) = grid.padding
    shape = 2 * grid.period, 2 * grid.period + columns
    pinned = pattern.filter_map(shape, first=(-above, -left)) < len(pattern.channels)
    (tall, wide), (height, width) = shape, grid.block_shape
    down = (np.arange(tall) + height // 2) // grid.period % 2
    across = (np.arange(wide) + width // 2) // grid.period % 2
    classes: BoolArray = pinned & (2 * down[:, None] + across == np.arange(CLASSES)[:, None, None])
    classes[_SOLVED] = pinned
    return classes.astype(np.float32)


_QUARTER = np.float32(0.25)
_NO_ENERGY = np.float32(1e-30)  # scene units squared
_LEAST_DIAGONAL = np.float32(1e-37)


@parallel_kernel()
def solve_fields(
    chunks: Chunks,
    padded: Floats2,
    patches: Pair,
    chunk_size: Pair,
    pins: Floats3,
    filters: Filters,
    limits: solver.Limits,
    fields: Floats3,
    residuals: Doubles1,
    used: Ints1,
) -> None:
    """Solve the fields of some rows of patches.

    Parameters
    ----------
    padded : Floats2
        Rows of patches of the padded frame, the first of which is even, with the filters' reach
        more on every side.
    patches : Pair
        First and end row of patches in these; chunks begin at the first.
    chunk_size : Pair
        Patches of a chunk without its halo, down and across.
    pins : Floats3
        See `_pins`.
    limits : Limits
        Norm of the residual relative to that of the right-hand side, both over the roots of the
        diagonal, and iterations.
    fields : Floats3
        (4, pixel rows, padded columns), written.
    residuals, used : Doubles1, Ints1
        (chunks,), written: relative residual of the worst field, and iterations.
    """
    period, reach = pins.shape[1] // 2, filters.smooth.shape[1] - 1
    height, width = (len(padded) - 2 * reach) // period, fields.shape[2] // period
    for chunk in range(chunks[0], chunks[1]):
        top, bottom, left, right = chunk_at(chunk, (patches[1] - patches[0], width), chunk_size)
        first, end = patches[0] + top, patches[0] + bottom
        above, before = max(first - HALO, 0), max(left - HALO, 0)
        below, after = min(end + HALO, height), min(right + HALO, width)
        size = (below - above) * period, (after - before) * period
        tall, wide = size[0] + 2 * reach, size[1] + 2 * reach
        rows, columns = slice(above * period, above * period + tall), before * period
        luminance = np.ascontiguousarray(padded[rows, columns : columns + wide])
        given = _given(pins, (above % 2 * period, before % 2 * period), size)
        links = solver.planes(4, size)
        _weigh(transmission(luminance, period, filters), links)
        solver.cut(links, size)
        # Together, so that planes do not lie a multiple of a page apart: those would share lines of
        # the cache.
        scale, unknowns = solver.planes(1, size)[0], zeros(2 * _SOLVED, *links.shape[1:])
        solution, residual = unknowns[:_SOLVED], unknowns[_SOLVED:]
        norm = _start(links, given, size[1], scale, residual)
        _scale(links, scale)
        system = solver.System(links, links[:0])
        residuals[chunk], used[chunk] = solver.solve(system, residual, solution, limits, norm)
        inner = (first - above) * period, (left - before) * period
        area = top * period, bottom * period, left * period, right * period
        _finish(solution, scale, given, inner, area, fields)


@kernel
def _given(pins: Floats3, place: Pair, size: Pair) -> FloatArray:
    """Values at the blocks of a chunk, in planes; the chunk begins at this place of the table."""
    given = solver.planes(CLASSES, size)
    for row in range(size[0]):
        source = (place[0] + row) % pins.shape[1]
        given[:, solver.BORDER + row, : size[1]] = pins[:, source, place[1] :][:, : size[1]]
    return given


@kernel
def _weigh(through: Floats3, links: Floats3) -> None:
    """Compute the weights of Eq. 12 as least transmissions: an exponential for each pixel, not for
    each pair.
    """
    (_, rows, width), one = through.shape, np.uintp(1)
    h, v, below = through[0].reshape(-1), through[1].reshape(-1), np.uintp(width)
    right, down = links[0].reshape(-1), links[1].reshape(-1)
    down_right, down_left = links[2].reshape(-1), links[3].reshape(-1)
    for place in range(solver.BORDER * width, (rows - solver.BORDER) * width):
        here = np.uintp(place)
        under, either = here + below, min(h[here], v[here])
        right[here] = min(h[here], h[here + one])
        down[here] = min(v[here], v[under])
        down_right[here] = min(either, h[under + one], v[under + one])
        down_left[here] = min(either, h[under - one], v[under - one])


@kernel
def transmission(luminance: Floats2, period: int, filters: Filters) -> FloatArray:
    """exp(-e_h) and exp(-e_v) of whole patches, two planes (see `planes`). A patch without
    gradients has 1.

    Parameters
    ----------
    luminance : Floats2
        Luminance, with the filters' reach more on every side.
    """
    reach, width = filters.smooth.shape[1] - 1, luminance.shape[1]
    rows, columns = luminance.shape[0] - 2 * reach, width - 2 * reach
    through, energy = solver.planes(2, (rows, columns)), zeros(2, period, width)
    for top in range(0, rows, period):
        energy[:] = ZERO
        around = luminance[top : top + period + 2 * reach].reshape(-1)
        for scale in range(len(filters.smooth)):
            smooth, slope = filters.smooth[scale], filters.slope[scale]
            _add_energy(around, width, smooth, slope, energy.reshape(2, -1))
        for axis in range(2):
            relative = _over_mean(energy[axis], columns)
            for row in range(period):
                source, line = energy[axis, row], through[axis, solver.BORDER + top + row]
                for column in range(columns):
                    line[column] = exponential(source[column] * relative[column])
    return through


@kernel
def _add_energy(lit: Floats1, width: int, smooth: Floats1, slope: Floats1, energy: Floats2) -> None:
    """Add |G_hs * l|^2 and |G_vs * l|^2 of some rows; these follow each other without a gap,
    columns too many have no meaning.

    Slopes are sums of differences of symmetric pairs, so that flat input gives exactly 0.
    """
    reach, count = len(smooth) - 1, energy.shape[1]
    smoothed, sloped = zeros(count + 2 * reach), zeros(count + 2 * reach)
    across, down = zeros(count), zeros(count)
    for step in range(reach + 1):
        above, below = lit[(reach - step) * width :], lit[(reach + step) * width :]
        weight, rise = smooth[step], slope[step]
        if weight == ZERO:  # beyond the end of a smaller scale
            break
        for index in range(count):
            smoothed[index] += weight * (above[index] + below[index])
            sloped[index] += rise * (below[index] - above[index])
    for step in range(reach + 1):
        left, right = smoothed[reach - step :], smoothed[reach + step :]
        weight, rise = smooth[step], slope[step]
        if weight == ZERO:  # beyond the end of a smaller scale
            break
        before, after = sloped[reach - step :], sloped[reach + step :]
        for index in range(count):
            across[index] += rise * (right[index] - left[index])
            down[index] += weight * (after[index] + before[index])
    horizontal, vertical = energy[0], energy[1]
    for index in range(count):
        horizontal[index] += across[index] * across[index]
        vertical[index] += down[index] * down[index]


@kernel
def _over_mean(energy: Floats2, columns: int) -> FloatArray:
    """-1 over the mean energy of each patch in a row of patches, 0 without energy (its inverse is
    no float32), at all columns.
    """
    period, sums = len(energy), zeros(columns)
    for row in range(period):
        sums += energy[row, :columns]
    for left in range(0, columns, period):
        patch = sums[left : left + period]
        total = patch.sum()
        patch[:] = np.float32(-period * period) / total if total > _NO_ENERGY else ZERO
    return sums


@kernel
def _start(links: Floats3, given: Floats3, width: int, scale: Floats2, residual: Floats3) -> float:
    """Write what scales the equations to a diagonal of one, and the start's residuals. Returns the
    largest square of a right side.

    The diagonal is the sum d of a pixel's links, the right side the sum of c[n, n'] times the
    values given at blocks n'. The start is the same in all four fields, a quarter at every other
    pixel: a pixel that edges cut off from every block is then shared by all, not left to the
    fourth.

    scale: d^(-1/2), 0 at the blocks.
    """
    solved, every = len(residual), zeros(*scale.shape)
    every[:] = ONE
    solver.linked_sum(links, every, scale)
    for row in range(solver.BORDER, len(scale) - solver.BORDER):
        line, pinned = scale[row], given[solved, row]
        for column in range(width):
            line[column] = (ONE - pinned[column]) / np.sqrt(max(line[column], _LEAST_DIAGONAL))
    _right_side(links, given[solved], scale, every)
    norm, start = 0.0, every.reshape(-1)
    for field in range(solved):
        _right_side(links, given[field], scale, residual[field])
        norm = max(norm, solver.product(residual[field], residual[field]))
        out = residual[field].reshape(-1)
        for index in range(len(out)):
            out[index] -= _QUARTER * start[index]
    return norm


@kernel
def _right_side(links: Floats3, values: Floats2, scale: Floats2, out: Floats2) -> None:
    """Write the scaled sum of the links to blocks."""
    solver.linked_sum(links, values, out)
    out *= scale


@kernel
def _scale(links: Floats3, scale: Floats2) -> None:
    """Scale the links."""
    (rows, width), one, below = scale.shape, np.uintp(1), np.uintp(scale.shape[1])
    roots = scale.reshape(-1)
    for link, step in enumerate((one, below, below + one, below - one)):
        line = links[link].reshape(-1)
        for place in range(solver.BORDER * width, (rows - solver.BORDER) * width):
            here = np.uintp(place)
            # From left to right: both roots may be as large as 3e18, their product with a weight is
            # at most one.
            line[here] = line[here] * roots[here] * roots[here + step]


@kernel
def _finish(
    solution: Floats3, scale: Floats2, given: Floats3, inner: Pair, area: Area, fields: Floats3
) -> None:
    """Write the four fields of an area: not below zero, and scaled to a sum of one, despite
    rounding and tolerance.

    inner: its first row and column in the chunk. area: in `fields`.
    """
    top, bottom, left, right = area
    for row in range(top, bottom):
        at, sums = solver.BORDER + inner[0] + row - top, zeros(right - left)
        pinned, roots = given[_SOLVED, at][inner[1] :], scale[at][inner[1] :]
        for field in range(_SOLVED):
            source, pin = solution[field, at][inner[1] :], given[field, at][inner[1] :]
            out = fields[field, row][left:]
            for column in range(len(sums)):
                start = pin[column] + _QUARTER * (ONE - pinned[column])
                out[column] = max(start + roots[column] * source[column], ZERO)
                sums[column] += out[column]
        last = fields[_SOLVED, row][left:]
        for column in range(len(sums)):
            last[column] = max(ONE - sums[column], ZERO)
            sums[column] = ONE / (sums[column] + last[column])
        for field in range(CLASSES):
            fields[field, row, left:right] *= sums
