"""Oriented medians on the coarse image of block chromaticities (end of section 3.2)."""

import numpy as np

from .arrays import Bools1, Doubles1, Doubles2, Doubles3, Ints1
from .compile import Pieces, kernel, parallel_kernel
from .functions import ORIENTATIONS, mirrored
from .lanes import WIDTH, Lanes, greater, lesser, load, store, where_less

SLACK = WIDTH
"""Columns after the mirrored border, so that the last vector stays inside the array."""
_LANES = WIDTH // 2  # of float64: the chromaticities are solved in double
_FIVE = 5  # taps, as in the paper: those have a network of comparisons of their own
_FAR = np.float64(np.inf)


@parallel_kernel()
def oriented_median(
    pieces: Pieces, before: Doubles3, after: Doubles3, columns: int, taps: int, changed: Bools1, found: Bools1
) -> None:
    """Replace each vector by whichever of its four oriented 1-D medians is nearest to it.

    before: (C, rows, taps // 2 + columns + taps // 2 + SLACK), with mirrored columns.
    after: same shape, written, with mirrored columns.
    columns: number of columns without the border.
    taps: length of the medians, odd, 3 or more.
    changed: bool (rows,), rows of `before` that the previous step changed; rows that see none of them are copied.
    found: bool (rows,), set for the rows that this one changes.
    """
    channels, rows = before.shape[:2]
    half = taps // 2
    for row in range(pieces[0], pieces[1]):
        near = np.array([mirrored(row + step, rows) for step in range(-half, half + 1)])
        if changed[near].any():
            _row_of_medians(before, after, row, near, columns, taps)
            for channel in range(channels):
                for column in range(half, half + columns):
                    if after[channel, row, column] != before[channel, row, column]:
                        found[row] = True
                _mirror(after[channel, row], columns, half)
        else:
            for channel in range(channels):
                for column in range(before.shape[2]):
                    after[channel, row, column] = before[channel, row, column]


@kernel
def _row_of_medians(before: Doubles3, after: Doubles3, row: int, near: Ints1, columns: int, taps: int) -> None:
    channels, half = before.shape[0], taps // 2
    medians, chosen = np.empty((channels, _LANES)), np.zeros((2, channels, _LANES))
    line = np.empty((taps, _LANES))
    for column in range(half, half + columns, _LANES):
        nearest, turn = load(before, (0, row, column)) * 0.0 + _FAR, 0
        for down, across in ORIENTATIONS:
            distance = load(before, (0, row, column)) * 0.0
            for channel in range(channels):
                if taps == _FIVE:
                    median = _median_of_five(
                        load(before, (channel, near[2 - 2 * down], column - 2 * across)),
                        load(before, (channel, near[2 - down], column - across)),
                        load(before, (channel, row, column)),
                        load(before, (channel, near[2 + down], column + across)),
                        load(before, (channel, near[2 + 2 * down], column + 2 * across)),
                    )
                else:
                    for step in range(-half, half + 1):
                        store(line, (step + half, 0), load(before, (channel, near[half + step * down], column + step * across)))
                    median = _median(line)
                store(medians, (channel, 0), median)
                away = median - load(before, (channel, row, column))
                distance += away * away
            for channel in range(channels):
                # Read here, written there: in one place the compiler makes it a masked store, which takes 20 cycles.
                kept = load(chosen, (turn, channel, 0))
                store(chosen, (1 - turn, channel, 0), where_less(distance, nearest, load(medians, (channel, 0)), kept))
            nearest, turn = lesser(distance, nearest), 1 - turn
        for channel in range(channels):
            store(after, (channel, row, column), load(chosen, (turn, channel, 0)))


@kernel
def _median_of_five(a: Lanes, b: Lanes, c: Lanes, d: Lanes, e: Lanes) -> Lanes:
    """Median of five by a selection network: neither the least nor the greatest of the first four can be the median."""
    low = greater(lesser(a, b), lesser(c, d))
    high = lesser(greater(a, b), greater(c, d))
    return greater(lesser(e, low), lesser(greater(e, low), high))


@kernel
def _median(line: Doubles2) -> Lanes:
    """Median of the rows of `line`, by bubble-sorting the larger half to the end."""
    taps = len(line)
    for end in range(taps - 1, taps // 2 - 1, -1):
        for place in range(end):
            a, b = load(line, (place, 0)), load(line, (place + 1, 0))
            store(line, (place, 0), lesser(a, b))
            store(line, (place + 1, 0), greater(a, b))
    return load(line, (taps // 2, 0))


@kernel
def _mirror(row: Doubles1, columns: int, half: int) -> None:
    for step in range(1, half + 1):
        row[half - step] = row[half + mirrored(-step, columns)]
        row[half + columns - 1 + step] = row[half + mirrored(columns - 1 + step, columns)]
