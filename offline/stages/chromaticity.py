"""One chromaticity per colour block by constrained least squares, and oriented medians against outliers (section 3.2, Eqs. 6-9).

Oriented medians on the coarse image of block chromaticities (end of section 3.2).
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from shared.arrays import BORDER, DoubleArray, FloatArray
from shared.progress import SILENT, Progress

from ..frame import BlockSums, Cleaned
from ..numerics.arrays import Bools1, Doubles1, Doubles2, Doubles3, Ints1
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import ORIENTATIONS, mirrored
from ..numerics.lanes import WIDTH, Lanes, greater, lesser, load, store, where_less
from ..numerics.pieces import BLOCK_ROWS, in_strips
from ..stage import CountOrNone, Range, StageSettings


@dataclass(frozen=True)
class ChromaticitySettings(StageSettings):
    """Block chromaticities, Eqs. 6-9, and the oriented medians after them.

    taps: length of the 1-D medians, odd; 5 in the paper, 1 = no medians.
    repetitions: largest number of repetitions of the medians ("till convergence" in the paper).
    """

    taps: Annotated[int, Range(lambda value: value >= 1 and value % 2 == 1, "an odd number")] = 5
    repetitions: CountOrNone = 20

    @property
    def kernels(self) -> tuple[str, ...]:
        """Those of the stage."""
        return ("oriented_median",) if self.taps > 1 else ()


# Least sigma_z of the regularisation, scene units: makes a block without light grey, and changes no other.
_LEAST_SIGMA = 1e-6
_LEAST_TOTAL = 0.5  # sum_i gamma_i c_i, 1 before the medians, above which scaling is harmless: it changes a vector by twice at most


def estimate_chromaticities(
    frame: Cleaned,
    luminance: FloatArray,
    settings: ChromaticitySettings,
    progress: Progress = SILENT,
    others: BlockSums | None = None,
) -> FloatArray:
    """c_j of every block of the grid, float32 (block rows, block columns, C); sum_i gamma_i c_i = 1 in each.

    Blocks that lie partly or wholly outside the frame take the value of the nearest whole block.

    luminance: (H, W), scene units.
    others: what other frames add to the sums of each whole block.
    """
    progress.stage("chromaticity", settings.repetitions)
    gamma, sums, sigma = frame.gamma, block_sums(frame, luminance), sigma_z(frame)
    chromaticity = sums.solved(sigma, gamma)
    if others is not None:
        chromaticity = (BlockSums(sums.weight, sums.weight * chromaticity) + others).solved(sigma, gamma)
    if settings.taps > 1:
        chromaticity = oriented_medians(chromaticity, settings.taps, settings.repetitions, progress)
    # Medians of single channels leave the constraint's plane (errata). Scaling brings the vectors back. Far off the plane, where
    # estimates are wild (darkness), scaling would blow them up: there the nearest point of the plane is the safe way back.
    scaled = np.empty_like(chromaticity)

    def constrain(rows: slice) -> None:
        total = (chromaticity[rows] @ gamma)[..., None]
        scaled[rows] = chromaticity[rows] / np.where(total > _LEAST_TOTAL, total, 1)
        if total.min() <= _LEAST_TOTAL:
            projected = chromaticity[rows] + (1 - total) * gamma / (gamma @ gamma)
            scaled[rows] = np.where(total > _LEAST_TOTAL, scaled[rows], projected)

    in_strips(constrain, len(scaled), BLOCK_ROWS)
    return frame.sites.grid.extend(scaled.astype(np.float32))


def block_sums(frame: Cleaned, luminance: FloatArray) -> BlockSums:
    """The sums of Eqs. 8-9 of each whole block. luminance: (H, W), scene units."""
    shape = *frame.sites.shape, len(frame.gamma)
    weight, product, signal = np.zeros(shape), np.zeros(shape), frame.signal

    def work(rows: slice) -> None:
        for channel, place in zip(frame.sites.channels, frame.sites.at(rows), strict=True):
            light = luminance[place].astype(np.float64)
            weight[rows, :, channel] += light**2
            product[rows, :, channel] += light * signal[place]

    in_strips(work, len(weight), BLOCK_ROWS)
    return BlockSums(weight, product)


def sigma_z(frame: Cleaned) -> float:
    """sigma_z of Eqs. 8-9, scene units: the noise of all channels at the mean sample of the whole blocks.

    An estimate counts as no noise here: texture raises it, and single scenes then lose 0.2 dB, while the mean gains 0.01 dB.
    """
    places, noise = frame.sites.places, None if frame.estimated else frame.noise
    level = 0.0
    for place in places:
        level += float(frame.signal[place].mean()) / len(places)
    variances = [noise.sigma(level, plane) ** 2 for plane in range(len(frame.gamma))] if noise else [0.0]
    return max(float(np.mean(variances)) ** 0.5, _LEAST_SIGMA)


def oriented_medians(chromaticity: DoubleArray, taps: int, repetitions: int, progress: Progress = SILENT) -> DoubleArray:
    """Replace each vector by the nearest of its 1-D medians along four orientations, and repeat until nothing changes.

    chromaticity: (rows, columns, C), the coarse image, mirrored at its border. Channels are filtered one by one.
    taps: length of the medians, odd, 3 or more.
    repetitions: largest number of repetitions.
    """
    (rows, columns), half = chromaticity.shape[:2], taps // 2
    iterations = 0
    wide = np.pad(chromaticity.transpose(2, 0, 1), ((0, 0), (0, 0), (half, half + SLACK)), mode=BORDER)
    before, changed = np.ascontiguousarray(wide), np.ones(rows, np.bool_)
    after = np.empty_like(before)
    while iterations < repetitions and changed.any():
        found = np.zeros_like(changed)
        oriented_median(before, after, columns, taps, changed, found)
        before, after, changed = after, before, found
        iterations += 1
        progress.advance()
    progress.solved("medians", iterations, float(changed.mean()))
    return np.ascontiguousarray(before[:, :, half : half + columns].transpose(1, 2, 0))


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
