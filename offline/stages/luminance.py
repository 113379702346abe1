"""Recovering luminance under the colour sites by a wavelet total-variation prior (section 3.1, Eqs. 1-5).

One iteration of hole filling (Eqs. 3-5) for any pattern, over the whole plane, in strips; each row of a band is computed once.

The wavelet frame is tight (synthesis undoes analysis), so instead of synthesising what shrinkage leaves, the kernel synthesises
what shrinkage removes and subtracts it from the plane. Rows without a hole are not synthesised.

Fill isolated blocks of holes (Eqs. 3-5): sixteen blocks at a time, all iterations at once.

The value that Eq. 3 gives a hole depends on the pixels up to four away from it. If no other block lies within four pixels of a
block, its few unknown pixels are a separate problem: the coefficients of all known pixels are computed once, and each iteration
adds what the holes contribute. The wavelet frame is tight (synthesis undoes analysis), so instead of synthesising what shrinkage
leaves, the kernel synthesises what shrinkage removes and subtracts it from the holes.
"""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BORDER, BoolArray, FloatArray, IndexArray, strips
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..numerics.arrays import Area, Floats1, Floats2, Floats3, Floats4, Frozen2, Ints1, Ints2, Pair, Scalar, Single
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import mirrored, scaled_reciprocal_root, zeros
from ..numerics.gaussian import smoothed
from ..numerics.lanes import WIDTH, Lanes, greater, lesser, load, store, total, where_less
from ..numerics.pieces import copied
from ..stage import Between, Count, Positive, StageSettings
from .luminance_network import refilled


@dataclass(frozen=True)
class LuminanceSettings(StageSettings):
    """Hole filling, Eqs. 1-5.

    iterations, decay: 50, and beta = 2^(-1/4), in the paper.
    threshold: shrinkage at the first iteration, scene units (1 in the paper); larger in frames brighter than 3 scene units, half of
        what they exceed 1 by.
    relative: the threshold is a multiple of the brightest sample instead, so that the picture does not depend on the exposure; and
        holes start from the samples around them, not from their own, which takes half the iterations.
    learned: a network that has seen photographs corrects what is filled in under blocks of 2 x 2 pixels
        (`luminance_network`).
    """

    kernels = "fill_blocks", "shrink_margins"
    iterations: Count = 50
    decay: Between = 2**-0.25
    threshold: Positive = 1.0
    relative: bool = False
    learned: bool = False


# Daubechies-2 scaling taps (Daubechies 1992, table 6.1) over sqrt(2): one level without decimation is then a tight frame, in which
# synthesis by the same taps undoes analysis.
_ROOT3 = 3**0.5
LOW: FloatArray = np.array([(1 + _ROOT3) / 8, (3 + _ROOT3) / 8, (3 - _ROOT3) / 8, (1 - _ROOT3) / 8], np.float32)
HIGH: FloatArray = (LOW[::-1] * [1, -1, 1, -1]).astype(np.float32)
_TAPS: FloatArray = np.stack([LOW, HIGH])

_AROUND = 1.0  # pixels: standard deviation of the start's means (0.0 dB); every scattered site has a panchromatic pixel in reach
# White, scene units, if gamma is 1 for three channels: the paper's threshold of 1 fills flat scenes up to there. At 3.3 its
# iterations end 4 % short (measured), so that brighter frames start with a larger one.
_WHITE = 3.0
_FEW = 4  # sites of a block that the samples in it are a good start for: those of a Bayer block
_PIECE = 128  # rows of blocks that are filled between two reports of progress


def recover_luminance(mosaic: Mosaic, settings: LuminanceSettings, progress: Progress = SILENT) -> FloatArray:
    """l[n] in scene units, float32 (H, W): the measured samples, and between them the minimiser of Eqs. 1-2.

    Each iteration shrinks wavelet coefficients and restores the measured samples (Eqs. 3-5); the threshold falls by beta each time.
    """
    luminance = _filled(mosaic, settings, progress)
    return refilled(luminance, mosaic) if settings.learned else luminance


def _filled(mosaic: Mosaic, settings: LuminanceSettings, progress: Progress) -> FloatArray:
    pattern, signal = mosaic.pattern, mosaic.signal
    first = _first_threshold(float(signal.max()), settings)
    thresholds = (first * settings.decay ** np.arange(settings.iterations)).astype(np.float32)
    around = settings.relative or len(pattern.sites) > _FEW
    rows, columns = (_isolated(pattern, mosaic.shape, axis) for axis in (0, 1))
    if len(rows) == 0 or len(columns) == 0:
        progress.stage("luminance", settings.iterations)
        holes = _holes(pattern, (pattern.period, signal.shape[1]))
        luminance, change = fill(_start(signal, holes) if around else signal, holes, thresholds, progress)
        progress.solved("luminance", settings.iterations, change)
        return luminance
    progress.stage("luminance", -(-len(rows) // _PIECE))
    luminance, changes = copied(signal), np.empty(len(rows), np.float32)
    change = _fill_margins(luminance, pattern, (rows, columns), thresholds, around)
    places, extent = np.array([site[:2] for site in pattern.sites]), pattern.block_shape
    starts, response = _shares(extent, places, around), _response(extent, places)
    for start in range(0, len(rows), _PIECE):
        piece = changes[start : start + _PIECE]
        origin, blocks = (int(rows[start]), int(columns[0])), (len(piece), len(columns))
        fill_blocks(signal, luminance, origin, blocks, pattern.period, extent, places, starts, response, _TAPS, thresholds, piece)
        progress.advance()
    progress.solved("luminance", settings.iterations, max(change, float(changes.max())))
    return luminance


def fill(signal: FloatArray, holes: BoolArray, thresholds: FloatArray, progress: Progress = SILENT) -> tuple[FloatArray, float]:
    """Fill the holes of a plane by one iteration of Eqs. 3-5 per threshold.

    signal: (H, W), scene units.
    holes: True at a hole, bool (rows, W); the rows repeat down the plane.
    thresholds: one per iteration, scene units.
    Returns the filled plane, float32 (H, W), and the largest change of a sample in the last iteration.
    """
    plane, result, where = _bordered(signal, holes)
    for threshold in thresholds:
        shrink_once(plane, result, signal.shape[1], where, _TAPS, threshold)
        plane, result = result, plane
        progress.advance()
    change = max(float(np.abs(plane[rows] - result[rows]).max()) for rows in strips(len(plane)))
    return plane[:, REACH : REACH + signal.shape[1]].copy(), change


def _first_threshold(brightest: float, settings: LuminanceSettings) -> float:
    if settings.relative:
        return settings.threshold * max(brightest, 0.0)
    return max(settings.threshold, (brightest - 1) / 2) if brightest > _WHITE else settings.threshold


def _start(signal: FloatArray, holes: BoolArray) -> FloatArray:
    """The plane with a mean of the panchromatic samples around each hole in it, float32 (H, W). holes: see `fill`.

    Holes of scattered sites and of many channels may be so wide that iterations which start from the samples in them, the paper's
    start, end too early: a flat scene is off by 80 % after 50 of them for eight channels in 2 x 4 pixels, and by 2 % after 62.
    """
    clear = ~holes[np.arange(len(signal)) % len(holes)]
    known = clear.astype(np.float32)
    around = smoothed(signal * known, _AROUND) / smoothed(known, _AROUND)
    return np.where(clear, signal, around)


def _shares(extent: tuple[int, int], holes: IndexArray, around: bool) -> FloatArray:
    """What the start of each hole of an isolated block is, as `fill_blocks` takes it: its sample, or as in `_start`."""
    own = np.zeros((len(holes), *(size + 2 * REACH for size in extent)), np.float32)
    own[np.arange(len(holes)), *(holes + REACH).T] = 1
    if not around:
        return own
    near = smoothed(own, _AROUND) * (1 - own.sum(axis=0))
    return near / near.sum(axis=(1, 2), keepdims=True)


def _bordered(signal: FloatArray, holes: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A plane with mirrored columns, its copy, and where its holes are, as `shrink_once` takes them."""
    plane = np.ascontiguousarray(np.pad(signal, ((0, 0), (REACH, REACH + SLACK)), mode=BORDER))
    return plane, plane.copy(), np.ascontiguousarray(np.pad(holes.astype(np.float32), ((0, 0), (0, SLACK))))


def _isolated(pattern: CfaPattern, shape: tuple[int, int], axis: int) -> IndexArray:
    """First rows (axis 0) or columns (axis 1) of the isolated blocks: no other block and no frame edge within `REACH` pixels."""
    grid = pattern.grid(shape)
    size, origins = pattern.block_shape[axis], (grid.rows, grid.columns)[axis]
    if pattern.period < size + REACH:
        return origins[:0]
    return origins[(origins >= REACH) & (origins + size + REACH <= shape[axis])]


def _holes(pattern: CfaPattern, shape: tuple[int, int], first: tuple[int, int] = (0, 0)) -> BoolArray:
    return pattern.filter_map(shape, first) < len(pattern.channels)


def _fill_margins(
    luminance: FloatArray, pattern: CfaPattern, isolated: tuple[IndexArray, IndexArray], thresholds: FloatArray, around: bool
) -> float:
    """Fill the blocks near the frame's edge, which are mirrored there. They lie in four margins, each filled like a whole plane.

    A margin ends where the isolated blocks begin, farther from its own holes than they reach. The margins at the sides are
    transposed, so that their rows are long. Returns the largest change of a sample in the last iteration.
    """
    (height, width), (rows, columns), (down, across) = luminance.shape, isolated, pattern.block_shape
    ends = [slice(0, int(rows[0])), slice(int(rows[-1]) + down, height)]
    sides = [slice(0, int(columns[0])), slice(int(columns[-1]) + across, width)]
    targets = [luminance[end] for end in ends] + [luminance[:, side].T for side in sides]
    holes = [_holes(pattern, (end.stop - end.start, width), (end.start, 0)) for end in ends]
    holes += [_holes(pattern, (height, side.stop - side.start), (0, side.start)).T for side in sides]
    starts = map(_start, targets, holes) if around else targets
    planes, results, where = zip(*map(_bordered, starts, holes), strict=True)
    lengths = tuple(target.shape[1] for target in targets)
    shrink_margins(planes, results, lengths, where, _TAPS, thresholds)
    last = results if len(thresholds) % 2 else planes
    for target, filled, length in zip(targets, last, lengths, strict=True):
        target[:] = filled[:, REACH : REACH + length]
    return max(float(np.abs(plane - result).max()) for plane, result in zip(planes, results, strict=True))


def _response(extent: tuple[int, int], holes: IndexArray) -> FloatArray:
    """How much a sample of 1 in each hole of a block adds to the high-pass coefficients that see it, as `fill_blocks` takes it."""
    (low_down, high_down), (low_across, high_across) = (
        np.stack([_seen(taps, size) for taps in _TAPS])[:, :, places] for size, places in zip(extent, holes.T, strict=True)
    )
    pairs = ((low_down, high_across), (high_down, low_across), (high_down, high_across))
    response = np.stack([down[:, None] * across for down, across in pairs]).reshape(-1, len(holes))
    return np.pad(response, ((0, 0), (0, -len(holes) % CHUNK))).reshape(len(response), -1, CHUNK)


def _seen(taps: FloatArray, size: int) -> FloatArray:
    """[coefficient, pixel]: the tap that multiplies a pixel in each coefficient that sees any pixel of a row of `size`."""
    seen = np.zeros((size + 3, size), np.float32)
    for pixel in range(size):
        seen[pixel : pixel + 4, pixel] = taps[::-1]
    return seen


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


CHUNK = 4
"""Holes that are computed together; their number is rounded up to a multiple of this."""

_ZERO, _ONE = np.float32(0), np.float32(1)
_NINE = np.float32(9.001)  # coefficients of a neighbourhood; more than rounding can hide


@parallel_kernel()
def fill_blocks(
    pieces: Pieces,
    signal: Frozen2,
    luminance: Floats2,
    first: Pair,
    blocks: Pair,
    period: int,
    extent: Pair,
    holes: Ints2,
    starts: Floats3,
    response: Floats3,
    taps: Floats2,
    thresholds: Floats1,
    changes: Floats1,
) -> None:
    """Write the filled holes of `blocks` (rows, columns) blocks to `luminance`.

    signal, luminance: (H, W), scene units.
    first: (row, column) of the first block's top left pixel. All blocks lie `REACH` or more pixels from the frame's edges.
    period: pixels from one block to the next, at least `extent` + `REACH` in both directions.
    extent: (rows, columns) of a block.
    holes: (holes, 2), row and column of each hole in a block.
    starts: (holes, rows + 2 `REACH`, columns + 2 `REACH`), the share of each sample in and around a block in the start of a hole.
    response: (3 (rows + 3) (columns + 3), chunks of holes, CHUNK), what a sample of 1 in each hole adds to the high-pass
        coefficients that see it.
    taps: (2, 4), low-pass and high-pass.
    thresholds: one per iteration, at least one, scene units.
    changes: (rows of blocks,), written: the largest change of a hole in the last iteration.
    """
    rows, columns = extent
    for row in range(pieces[0], pieces[1]):
        window = zeros(rows + 2 * REACH, columns + 2 * REACH, WIDTH)
        energy, half = zeros(_BANDS, rows + 5, columns + 5, WIDTH), zeros(2, rows + 5, columns + 2 * REACH, WIDTH)
        fixed, removed = zeros(len(response), WIDTH), zeros(len(response), WIDTH)
        values, before = zeros(response.shape[1] * CHUNK, WIDTH), zeros(response.shape[1] * CHUNK, WIDTH)
        changes[row], places = _ZERO, np.empty(WIDTH, np.intp)
        for group in range(0, blocks[1], WIDTH):
            # The spare lanes of the last group repeat the last block.
            for lane in range(WIDTH):
                places[lane] = first[1] + period * min(group + lane, blocks[1] - 1)
            top = first[0] + row * period
            _gather(signal, top, places, holes, starts, window, values)
            _decompose_window(window, taps, half, fixed, energy)
            _iterate(fixed, energy, response, thresholds, removed, values, before)
            for hole in range(len(holes)):
                for lane in range(WIDTH):
                    changes[row] = max(changes[row], abs(values[hole, lane] - before[hole, lane]))
                    luminance[top + holes[hole, 0], places[lane] + holes[hole, 1]] = values[hole, lane]


@kernel
def _gather(signal: Floats2, top: int, places: Ints1, holes: Ints2, starts: Floats3, window: Floats3, values: Floats2) -> None:
    """Copy the surroundings of the blocks at row `top` to `window`, one block per lane, and the starts of holes to `values`."""
    for down in range(window.shape[0]):
        for across in range(window.shape[1]):
            for lane in range(WIDTH):
                window[down, across, lane] = signal[top + down - REACH, places[lane] + across - REACH]
    for hole in range(len(holes)):
        start = load(window, (0, 0, 0)) * _ZERO
        for down in range(window.shape[0]):
            for across in range(window.shape[1]):
                start += starts[hole, down, across] * load(window, (down, across, 0))
        store(values, (hole, 0), start)
    for hole in range(len(holes)):
        for lane in range(WIDTH):
            window[holes[hole, 0] + REACH, holes[hole, 1] + REACH, lane] = _ZERO


@kernel
def _decompose_window(window: Floats3, taps: Floats2, half: Floats4, fixed: Floats2, energy: Floats4) -> None:
    """Compute the high-pass coefficients without the holes: to `fixed` those that holes add to, to `energy` the squares of all.

    half: (2, energy's rows, the window's columns, lanes), for what is filtered vertically alone, by each row of `taps`.
    """
    rows, columns = energy.shape[1:3]
    for kind in range(2):
        for row in range(rows):
            for column in range(columns + 3):
                total = taps[kind, 0] * load(window, (row, column, 0))
                for i in range(1, 4):
                    total += taps[kind, i] * load(window, (row + i, column, 0))
                store(half, (kind, row, column, 0), total)
    place = 0
    for band in range(_BANDS):
        kind, across = (band + 1) // 2, taps[(band + 1) % 2]
        for row in range(rows):
            for column in range(columns):
                coefficient = across[0] * load(half, (kind, row, column, 0))
                for j in range(1, 4):
                    coefficient += across[j] * load(half, (kind, row, column + j, 0))
                store(energy, (band, row, column, 0), coefficient * coefficient)
                if 0 < row < rows - 1 and 0 < column < columns - 1:
                    store(fixed, (place, 0), coefficient)
                    place += 1


@kernel
def _iterate(
    fixed: Floats2, energy: Floats4, response: Floats3, thresholds: Floats1, removed: Floats2, values: Floats2, before: Floats2
) -> None:
    """Run Eqs. 3-5 on the `values` of the holes, one iteration per threshold; `before`: what they were before the last one."""
    rows, columns, last = energy.shape[1] - 2, energy.shape[2] - 2, response.shape[1] - 1
    whole = True  # whether shrinkage removes everything, as it does while the threshold is large
    for threshold in thresholds:
        for hole in range(len(values)):
            store(before, (hole, 0), load(values, (hole, 0)))
        for chunk in range(last):
            source = removed if chunk else fixed
            h0, h1, h2, h3 = _four_from(values, CHUNK * chunk)
            for place in range(len(fixed)):
                c = response[place, chunk]
                store(removed, (place, 0), load(source, (place, 0)) + c[0] * h0 + c[1] * h1 + c[2] * h2 + c[3] * h3)
        source = removed if last else fixed
        h0, h1, h2, h3 = _four_from(values, CHUNK * last)
        place = 0
        for band in range(_BANDS):
            for row in range(rows):
                for column in range(columns):
                    c = response[place, last]
                    coefficient = load(source, (place, 0)) + c[0] * h0 + c[1] * h1 + c[2] * h2 + c[3] * h3
                    store(removed, (place, 0), coefficient)
                    store(energy, (band, row + 1, column + 1, 0), coefficient * coefficient)
                    place += 1
        whole = whole and _removes_all(energy, threshold)
        if not whole:
            _shrink_window(energy, threshold, removed)
        for chunk in range(last + 1):
            h0, h1, h2, h3 = _four_from(values, CHUNK * chunk)
            for place in range(len(fixed)):
                c = response[place, chunk]
                gone = load(removed, (place, 0))
                h0 -= c[0] * gone
                h1 -= c[1] * gone
                h2 -= c[2] * gone
                h3 -= c[3] * gone
            for hole, value in enumerate((h0, h1, h2, h3)):
                store(values, (CHUNK * chunk + hole, 0), value)


@kernel
def _shrink_window(energy: Floats4, threshold: Scalar, removed: Floats2) -> None:
    """Eq. 5: shrinkage removes the fraction threshold / (norm of the neighbourhood) of a coefficient, at most everything."""
    place = 0
    for band in range(_BANDS):
        for row in range(energy.shape[1] - 2):
            left, middle = _down(energy, band, row, 0), _down(energy, band, row, 1)
            for column in range(energy.shape[2] - 2):
                right = _down(energy, band, row, column + 2)
                part = lesser(_ONE, scaled_reciprocal_root(left + middle + right, threshold))
                store(removed, (place, 0), load(removed, (place, 0)) * part)
                left, middle = middle, right
                place += 1


@kernel
def _removes_all(energy: Floats4, threshold: Scalar) -> bool:
    """Whether no neighbourhood of nine coefficients can have a norm above the threshold, in any lane."""
    most = load(energy, (0, 0, 0, 0))
    for band in range(_BANDS):
        for row in range(energy.shape[1]):
            for column in range(energy.shape[2]):
                most = greater(most, load(energy, (band, row, column, 0)))
    removed: bool = total(where_less(most * _NINE, threshold * threshold, _ZERO, _ONE)) == _ZERO
    return removed


@kernel
def _four_from(values: Floats2, first: int) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """Four rows of `values`."""
    return load(values, (first, 0)), load(values, (first + 1, 0)), load(values, (first + 2, 0)), load(values, (first + 3, 0))


@kernel
def _down(energy: Floats4, band: int, row: int, column: int) -> Lanes:
    """Sum of three vertically adjacent squares."""
    return (
        load(energy, (band, row, column, 0)) + load(energy, (band, row + 1, column, 0)) + load(energy, (band, row + 2, column, 0))
    )
