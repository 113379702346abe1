"""Luminance under the colour sites, by a total-variation prior on wavelet coefficients (section
3.1, Eqs. 1-5).

Where a pixel is panchromatic its sample m is its luminance; elsewhere luminance minimises the norm
of its high-pass coefficients:

    l = argmin_l sum_i |f_i * l|_TV,   l[n] = m[n] for panchromatic n                          (1)
    |w|_TV = sum_n ((k * w^2)[n])^(1/2)                                                        (2)

f_i are the three high-pass filters of one level of Daubechies-2 wavelets without decimation, k is a
box of 3 x 3 ones. From l_0 = m, iteration t shrinks the coefficients w_i = f_i * l_t and restores
the panchromatic samples:

    l_(t+1)[n] = m[n] for panchromatic n, l*_t[n] elsewhere                                    (3)
    l*_t = synthesis of w*_i, argmin sum_n (l_t - l*)^2 + beta^t sum_i |f_i * l*|_TV           (4)
    w*_i = max(0, s_i - beta^t) / s_i w_i,   s_i = (k * w_i^2)^(1/2)                           (5)

tests/reference/luminance.py transcribes this literally. The wavelet frame is tight: synthesis
undoes analysis. So the kernels synthesise what Eq. 5 removes, w_i min(1, beta^t / s_i), and
subtract it from the holes, which are all that changes.

A value depends on the pixels up to four away. `shrink_once` runs an iteration on any plane, with
any pattern of holes. Blocks of holes with no other block in reach are problems of their own with
few unknowns: `fill_blocks` runs all iterations of sixteen blocks at once. It takes a quarter of the
time, and the general kernel in its place would make the preset `paper` 1.5 times as slow.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...shared import CfaPattern, Mosaic
from ...shared.arrays import BORDER, BoolArray, FloatArray, IndexArray, Pair
from ...shared.progress import SILENT, Progress
from ..numerics.arrays import Bools2, Floats1, Floats2, Floats3, Floats4, Ints1, Ints2, Single
from ..numerics.chunks import in_strips
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.functions import mirror_ends, mirrored, scaled_reciprocal_root, zeros
from ..numerics.gaussian import TRUNCATE, smoothed
from ..numerics.lanes import WIDTH, Lanes, lesser, load, store
from ..stage import Between, Count, Positive, StageSettings
from .luminance_network import correct_fill


@dataclass(frozen=True)
class LuminanceSettings(StageSettings):
    """Hole filling, Eqs. 1-5.

    Attributes
    ----------
    iterations, decay : Count, Between
        50, and beta = 2^(-1/4), in the paper.
    threshold : Positive
        Shrinkage at the first iteration, scene units (1 in the paper); larger in frames brighter
        than 3 scene units, half of what they exceed 1 by.
    relative : bool
        The threshold is a multiple of the brightest sample instead, so that the picture does not
        depend on the exposure; and holes start from the samples around them, not from their own,
        which takes half the iterations.
    learned : bool
        A network that has seen photographs corrects what is filled in under blocks of 2 x 2 pixels
        (`luminance_network`).
    """

    iterations: Count = 50
    decay: Between = 2**-0.25
    threshold: Positive = 1.0
    relative: bool = False
    learned: bool = False


REACH = 4
"""Radius in pixels of the area on which a new value depends: three for the taps, one for the 3 x 3
neighbourhood of Eq. 2.
"""
_ROOT3 = 3**0.5
# Daubechies-2 scaling taps (Daubechies 1992, table 6.1) over sqrt(2), which makes the frame tight,
# and the wavelet's.
_LOW = np.array([1 + _ROOT3, 3 + _ROOT3, 3 - _ROOT3, 1 - _ROOT3]) / 8
_TAPS: FloatArray = np.stack([_LOW, _LOW[::-1] * [1, -1, 1, -1]]).astype(np.float32)
# The taps down and across of the three high-pass subbands, (3, 4, 4).
_FILTERS: FloatArray = np.stack([np.outer(_TAPS[i], _TAPS[j]) for i, j in ((0, 1), (1, 0), (1, 1))])

# Pixels: standard deviation of the start's means; every scattered site has a panchromatic pixel in
# reach.
_AROUND = 1.0
# White, scene units, if gamma is 1 for three channels: the paper's threshold of 1 fills flat scenes
# up to there. At 3.3 its iterations end 4 % short (measured), so that brighter frames start with a
# larger one.
_WHITE = 3.0
# sites of a block that the samples in it are a good start for: those of a Bayer block
_BAYER_SITES = 4


def recover_luminance(
    mosaic: Mosaic, settings: LuminanceSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] in scene units, float32 (H, W): the measured samples, and between them the result of
    Eqs. 3-5.

    The threshold falls by beta with each iteration.
    """
    pattern, signal = mosaic.pattern, mosaic.signal
    first, brightest = settings.threshold, float(signal.max())
    if settings.relative:
        first *= max(brightest, 0.0)
    elif brightest > _WHITE:
        first = max(first, (brightest - 1) / 2)
    thresholds = (first * settings.decay ** np.arange(settings.iterations)).astype(np.float32)
    holes = ~pattern.panchromatic_mask((pattern.period, signal.shape[1]))
    averaged = settings.relative or len(pattern.sites) > _BAYER_SITES
    start = _around(signal, holes) if averaged else signal.copy()
    rows, columns = (_isolated(pattern, mosaic.shape, axis) for axis in (0, 1))
    if len(rows) and len(columns):
        progress.stage("reconstructing luminance", 1)
        luminance = _fill_isolated(start, pattern, (rows, columns), thresholds, progress)
    else:
        progress.stage("reconstructing luminance", settings.iterations)
        luminance = fill(start, holes, thresholds, progress)
    return correct_fill(luminance, mosaic) if settings.learned else luminance


def fill(
    start: FloatArray, holes: BoolArray, thresholds: FloatArray, progress: Progress = SILENT
) -> FloatArray:
    """Fill the holes of a plane, float32 (H, W), by one iteration of Eqs. 3-5 per threshold.

    Parameters
    ----------
    start : FloatArray
        (H, W), scene units.
    holes : BoolArray
        True at a hole, bool (rows, W); the rows repeat down the plane.
    thresholds : FloatArray
        One per iteration, scene units.
    """
    plane = np.ascontiguousarray(np.pad(start, ((0, 0), (REACH, REACH)), mode=BORDER))
    result, holes = plane.copy(), np.ascontiguousarray(holes)
    for threshold in thresholds:
        shrink_once(plane, result, holes, threshold)
        plane, result = result, plane
        progress.advance()
    return plane[:, REACH:-REACH].copy()


def _around(signal: FloatArray, holes: BoolArray) -> FloatArray:
    """The plane with a mean of the panchromatic samples around each hole in it, float32 (H, W).
    holes: see `fill`.

    Holes of scattered sites and of many channels may be so wide that iterations which start from
    the samples in them, the paper's start, end too early: a flat scene is off by 80 % after 50 of
    them for eight channels in 2 x 4 pixels, and by 2 % after 62.
    """
    start, reach = np.empty_like(signal), int(TRUNCATE * _AROUND)

    def work(rows: slice) -> None:
        top = max(rows.start - reach, 0)
        cut = signal[top : rows.stop + reach]
        clear = ~holes[np.arange(top, top + len(cut)) % len(holes)]
        known = clear.astype(np.float32)
        mean = smoothed(cut * known, _AROUND) / smoothed(known, _AROUND)
        start[rows] = np.where(clear, cut, mean)[rows.start - top : rows.stop - top]

    in_strips(work, len(signal))
    return start


def _isolated(pattern: CfaPattern, shape: tuple[int, int], axis: int) -> IndexArray:
    """First rows (axis 0) or columns (axis 1) of the isolated blocks: no other block and no frame
    edge within `REACH` pixels.
    """
    grid = pattern.grid(shape)
    size, origins = pattern.block_shape[axis], (grid.rows, grid.columns)[axis]
    if pattern.period < size + REACH:
        return origins[:0]
    return origins[(origins >= REACH) & (origins + size + REACH <= shape[axis])]


def _fill_isolated(
    start: FloatArray,
    pattern: CfaPattern,
    isolated: tuple[IndexArray, IndexArray],
    thresholds: FloatArray,
    progress: Progress,
) -> FloatArray:
    """Fill the holes of `start`, in place, and return it; blocks are isolated except near the
    frame's edge. isolated: see `_isolated`.
    """
    (rows, columns), (down, across) = isolated, pattern.block_shape
    # Blocks near the edge are mirrored there. They lie in four margins that end where isolated
    # blocks begin, out of their reach.
    below, right = int(rows[-1]) + down, int(columns[-1]) + across
    corners = [(0, 0), (below, 0), (0, 0), (0, right)]
    edges = [np.s_[: rows[0], :], np.s_[below:, :], np.s_[:, : columns[0]], np.s_[:, right:]]
    margins = []
    for corner, edge in zip(corners, edges, strict=True):
        cut, holes = start[edge], ~pattern.panchromatic_mask(start[edge].shape, corner)
        if len(cut) > cut.shape[1]:  # rows are long, for speed
            margins.append(fill(cut.T, holes.T, thresholds).T)
        else:
            margins.append(fill(cut, holes, thresholds))
    for edge, filled in zip(edges, margins, strict=True):
        start[edge] = filled
    places, extent = np.array([site[:2] for site in pattern.sites]), pattern.block_shape
    inside = np.flatnonzero(np.pad(np.ones((3, down + 3, across + 3)), ((0, 0), (1, 1), (1, 1))))
    grid = (int(rows[0]), int(columns[0])), (len(rows), len(columns)), pattern.period
    fill_blocks(start, Blocks(*grid, extent, places, _response(extent, places), inside), thresholds)
    progress.advance()
    return start


def _response(extent: Pair, holes: IndexArray) -> FloatArray:
    """Return what a sample of 1 in each hole of a block adds to the high-pass coefficients that see
    it; see `Blocks`.
    """
    quads = -(-len(holes) // QUAD)
    response = np.zeros((3, extent[0] + 3, extent[1] + 3, quads * QUAD), np.float32)
    for hole, (row, column) in enumerate(holes):
        response[:, row : row + 4, column : column + 4, hole] = _FILTERS[:, ::-1, ::-1]
    return response.reshape(-1, quads, QUAD)


_STRIP = 64  # rows of a chunk; chosen for speed


@parallel_kernel(chunks=lambda plane, *_: -(-len(plane) // _STRIP))
def shrink_once(
    chunks: Chunks, plane: Floats2, result: Floats2, holes: Bools2, threshold: Single
) -> None:
    """Shrink the coefficients of a plane once, and write the new values of its holes to `result`.

    Parameters
    ----------
    plane : Floats2
        (H, REACH + W + REACH), with mirrored columns.
    result : Floats2
        Same shape, equal to `plane` except in the holes; holes are written, mirrored ones too.
    holes : Bools2
        bool (rows, W), True at a hole; the rows repeat down the plane.
    threshold : Single
        Scene units.
    """
    height, width = len(plane), holes.shape[1]
    low_pass, high_pass = _TAPS
    full = np.array([line.any() for line in holes])
    low, high, change = zeros(width + 2 * REACH), zeros(width + 2 * REACH), zeros(width)
    squares, subbands, removed = zeros(width + 5), zeros(3, 3, width + 5), zeros(3, 4, width + 3)
    for strip in range(chunks[0], chunks[1]):
        first, end = strip * _STRIP, min(height, (strip + 1) * _STRIP)
        # Row r of the subbands sees rows r - 4 to r - 1 of the plane. The last three rows are kept,
        # and four of what is removed.
        for row in range(first, end + REACH + 1):
            r0, r1 = plane[mirrored(row - 4, height)], plane[mirrored(row - 3, height)]
            r2, r3 = plane[mirrored(row - 2, height)], plane[mirrored(row - 1, height)]
            _combine(low_pass, r0, r1, r2, r3, low)
            _combine(high_pass, r0, r1, r2, r3, high)
            _combine(high_pass, low, low[1:], low[2:], low[3:], subbands[0, row % 3])
            _combine(low_pass, high, high[1:], high[2:], high[3:], subbands[1, row % 3])
            _combine(high_pass, high, high[1:], high[2:], high[3:], subbands[2, row % 3])
            for subband in range(3):
                out = removed[subband, (row - 1) % 4]
                _shrink(subbands[subband], (row - 1) % 3, threshold, squares, out)
            target = row - REACH - 1
            line = target % len(holes)
            if target >= first and full[line]:
                _synthesise(removed, target, low, high, change)
                for column in range(width):
                    gone = change[column] if holes[line, column] else ZERO
                    result[target, REACH + column] = plane[target, REACH + column] - gone
                mirror_ends(result[target], REACH)


@kernel
def _combine(taps: Floats1, a: Floats1, b: Floats1, c: Floats1, d: Floats1, out: Floats1) -> None:
    t0, t1, t2, t3 = taps
    for column in range(len(out)):
        out[column] = t0 * a[column] + t1 * b[column] + t2 * c[column] + t3 * d[column]


@kernel
def _add(taps: Floats1, a: Floats1, b: Floats1, c: Floats1, d: Floats1, out: Floats1) -> None:
    t0, t1, t2, t3 = taps
    for column in range(len(out)):
        out[column] += t0 * a[column] + t1 * b[column] + t2 * c[column] + t3 * d[column]


@kernel
def _shrink(three: Floats2, middle: int, threshold: Single, squares: Floats1, out: Floats1) -> None:
    """Compute what Eq. 5 removes from a row of a subband, of which `three` are given."""
    a, b, c = three[0], three[1], three[2]
    for column in range(len(squares)):
        squares[column] = a[column] * a[column] + b[column] * b[column] + c[column] * c[column]
    after, last, line = squares[1:], squares[2:], three[middle, 1:]
    for column in range(len(out)):
        size = np.sqrt(squares[column] + after[column] + last[column])
        out[column] = line[column] * min(ONE, threshold / size)


@kernel
def _synthesise(removed: Floats3, row: int, low: Floats1, high: Floats1, out: Floats1) -> None:
    """Synthesise a row of the plane from rows row + 1 to row + 4 of the subbands; the taps are
    reversed.
    """
    low_back, high_back = _TAPS[:, ::-1]
    a, b, c, d = (row + 1) % 4, (row + 2) % 4, (row + 3) % 4, row % 4
    low, high = low[: removed.shape[2]], high[: removed.shape[2]]
    _combine(high_back, removed[1, a], removed[1, b], removed[1, c], removed[1, d], low)
    _combine(low_back, removed[0, a], removed[0, b], removed[0, c], removed[0, d], high)
    _add(high_back, removed[2, a], removed[2, b], removed[2, c], removed[2, d], high)
    _combine(low_back, low, low[1:], low[2:], low[3:], out)
    _add(high_back, high, high[1:], high[2:], high[3:], out)


QUAD = 4
"""Holes that are computed together; their number is rounded up to a multiple of this."""


class Blocks(NamedTuple):
    """Rows of isolated blocks.

    Attributes
    ----------
    first : Pair
        Row and column of the first one's top left pixel. All lie `REACH` or more pixels from the
        frame's edges.
    grid : Pair
        Rows of blocks, and blocks in a row.
    period : int
        Pixels from one to the next, at least `extent` + `REACH` in both directions.
    extent : Pair
        Rows and columns of a block.
    holes : Ints2
        (holes, 2), row and column of each hole in a block.
    response : Floats3
        (3 (rows + 3) (columns + 3), quads of holes, QUAD), what a sample of 1 in each hole adds
        to the coefficients that see any.
    inside : Ints1
        Where those are among all coefficients of the three subbands, one after the other.
    """

    first: Pair
    grid: Pair
    period: int
    extent: Pair
    holes: Ints2
    response: Floats3
    inside: Ints1


@parallel_kernel(chunks=lambda luminance, blocks, thresholds: blocks.grid[0])
def fill_blocks(chunks: Chunks, luminance: Floats2, blocks: Blocks, thresholds: Floats1) -> None:
    """Fill the holes of isolated blocks in place, sixteen at a time.

    Parameters
    ----------
    luminance : Floats2
        (H, W), scene units, with the start in the holes.
    thresholds : Floats1
        One per iteration, at least one, scene units.
    """
    (rows, columns), holes = blocks.extent, blocks.holes
    inner, quads, _ = blocks.response.shape
    tall, wide = rows + 2 * REACH, columns + 2 * REACH
    for row in range(chunks[0], chunks[1]):
        window, squares = zeros(tall, wide, WIDTH), zeros(3, tall - 3, wide - 3, WIDTH)
        known, removed = zeros(inner, WIDTH), zeros(inner, WIDTH)
        values = zeros(quads * QUAD, WIDTH)
        flat = squares.reshape(-1, WIDTH)
        top, places = blocks.first[0] + row * blocks.period, np.empty(WIDTH, np.intp)
        for group in range(0, blocks.grid[1], WIDTH):
            for lane in range(WIDTH):  # the spare ones of the last group repeat the last block
                number = min(group + lane, blocks.grid[1] - 1)
                places[lane] = blocks.first[1] + blocks.period * number
            for i in range(tall):
                for j in range(wide):
                    for lane in range(WIDTH):
                        window[i, j, lane] = luminance[top + i - REACH, places[lane] + j - REACH]
            for hole in range(len(holes)):
                i, j = holes[hole, 0] + REACH, holes[hole, 1] + REACH
                for lane in range(WIDTH):
                    values[hole, lane], window[i, j, lane] = window[i, j, lane], ZERO
            _decompose_blocks(window, squares, known)
            for threshold in thresholds:
                _respond(values, known, blocks, removed, flat)
                _shrink_blocks(squares, threshold, removed)
                _remove(removed, blocks.response, values)
            for hole in range(len(holes)):
                i, j = top + holes[hole, 0], holes[hole, 1]
                for lane in range(WIDTH):
                    luminance[i, places[lane] + j] = values[hole, lane]


@kernel
def _decompose_blocks(window: Floats3, squares: Floats4, known: Floats2) -> None:
    """Compute the high-pass coefficients without the holes: those that holes add to, all but the
    outermost, and all squares.
    """
    (_, rows, columns, _), place = squares.shape, 0
    for subband in range(3):
        for row in range(rows):
            for column in range(columns):
                total = load(window, (0, 0, 0)) * ZERO
                for i in range(4):
                    for j in range(4):
                        total += _FILTERS[subband, i, j] * load(window, (row + i, column + j, 0))
                store(squares, (subband, row, column, 0), total * total)
                if 0 < row < rows - 1 and 0 < column < columns - 1:
                    store(known, (place, 0), total)
                    place += 1


@kernel
def _respond(
    values: Floats2, known: Floats2, blocks: Blocks, coefficients: Floats2, squares: Floats2
) -> None:
    """Add the holes' contribution to the known coefficients. squares: of all, (coefficients,
    WIDTH).
    """
    for quad in range(blocks.response.shape[1]):
        h0, h1, h2, h3 = _quad(values, quad)
        others = coefficients if quad else known
        for place in range(len(known)):
            c = blocks.response[place, quad]
            total = load(others, (place, 0)) + c[0] * h0 + c[1] * h1 + c[2] * h2 + c[3] * h3
            store(coefficients, (place, 0), total)
            store(squares, (blocks.inside[place], 0), total * total)


@kernel
def _shrink_blocks(squares: Floats4, threshold: Single, removed: Floats2) -> None:
    """Replace coefficients, all but the outermost, by what Eq. 5 removes from them."""
    (_, rows, columns, _), place = squares.shape, 0
    for subband in range(3):
        for row in range(1, rows - 1):
            left, middle = _energy(squares, subband, row, 0), _energy(squares, subband, row, 1)
            for column in range(1, columns - 1):
                right = _energy(squares, subband, row, column + 1)
                weight = lesser(ONE, scaled_reciprocal_root(left + middle + right, threshold))
                store(removed, (place, 0), load(removed, (place, 0)) * weight)
                left, middle = middle, right
                place += 1


@kernel
def _energy(squares: Floats4, subband: int, row: int, column: int) -> Lanes:
    """Sum of three vertically adjacent squares."""
    above = load(squares, (subband, row - 1, column, 0))
    below = load(squares, (subband, row + 1, column, 0))
    return above + load(squares, (subband, row, column, 0)) + below


@kernel
def _remove(removed: Floats2, response: Floats3, values: Floats2) -> None:
    """Subtract from the holes what is synthesised of the removed coefficients."""
    for quad in range(response.shape[1]):
        h0, h1, h2, h3 = _quad(values, quad)
        for place in range(len(removed)):
            c, gone = response[place, quad], load(removed, (place, 0))
            h0 -= c[0] * gone
            h1 -= c[1] * gone
            h2 -= c[2] * gone
            h3 -= c[3] * gone
        for hole, value in enumerate((h0, h1, h2, h3)):
            store(values, (QUAD * quad + hole, 0), value)


@kernel
def _quad(values: Floats2, quad: int) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    i = QUAD * quad
    h0, h1, h2 = load(values, (i, 0)), load(values, (i + 1, 0)), load(values, (i + 2, 0))
    return h0, h1, h2, load(values, (i + 3, 0))
