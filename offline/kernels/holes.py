"""Fill isolated blocks of holes (Eqs. 3-5): sixteen blocks at a time, all iterations at once.

The value that Eq. 3 gives a hole depends on the pixels up to four away from it. If no other block lies within four pixels of a
block, its few unknown pixels are a separate problem: the coefficients of all known pixels are computed once, and each iteration
adds what the holes contribute. The wavelet frame is tight (synthesis undoes analysis), so instead of synthesising what shrinkage
leaves, the kernel synthesises what shrinkage removes and subtracts it from the holes.
"""

import numpy as np

from .arrays import Floats1, Floats2, Floats3, Floats4, Frozen2, Ints1, Ints2, Pair, Scalar
from .compile import Pieces, kernel, parallel_kernel
from .functions import scaled_reciprocal_root, zeros
from .shrinkage import REACH, _BANDS
from .lanes import WIDTH, Lanes, greater, lesser, load, store, total, where_less


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
