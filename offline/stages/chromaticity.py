"""One chromaticity per colour block by constrained least squares, and oriented medians against
outliers (section 3.2, Eqs. 6-9).

A block is taken for one material: m[n_i] = c_i l[n_i] at each site of channel i (Eq. 6), and sum_i
gamma_i c_i = 1 (Eq. 7). So

    c = argmin_c sum_i (sum_(n_i) (l[n_i] c_i - m[n_i])^2 + sigma_z^2 (c_i - 1 / sum gamma)^2)   (8)
    under sum_i gamma_i c_i = 1                                                                 (9)

where sigma_z, the noise, pulls dark blocks towards grey. `frame.BlockSums` solves it. Medians of
five blocks along four orientations then propose values for each block, channel by channel; the
nearest proposal replaces its chromaticity, until nothing changes. tests/reference/chromaticity.py
transcribes this literally.
"""

from dataclasses import dataclass

import numpy as np

from ...shared.arrays import BORDER, DoubleArray, FloatArray
from ...shared.progress import SILENT, Progress
from ..frame import BlockSums, Frame
from ..numerics.arrays import Bools1, Doubles1, Doubles3
from ..numerics.chunks import BLOCK_ROWS, in_strips
from ..numerics.compile import Chunks, kernel, parallel_kernel
from ..numerics.functions import ORIENTATIONS, mirror_ends, mirrored
from ..stage import CountOrNone, StageSettings


@dataclass(frozen=True)
class ChromaticitySettings(StageSettings):
    """Chromaticities of blocks, by Eqs. 6-9 and the oriented medians after them, or by a network.

    Attributes
    ----------
    repetitions : CountOrNone
        Largest number of repetitions of the medians of five blocks ("till convergence" in the
        paper); 0 = no medians.
    learned : bool
        Let a network find them where it serves the pattern (`stages.block_network`); not in the
        paper.
    """

    repetitions: CountOrNone = 20
    learned: bool = False


# Least sigma_z of the regularisation, scene units: makes a dark block grey, and changes no
# other.
_LEAST_SIGMA = 1e-6
# sum_i gamma_i c_i, 1 before the medians, above which scaling is harmless: it changes a vector by
# twice at most.
_LEAST_TOTAL = 0.5


def estimate_chromaticities(
    frame: Frame, settings: ChromaticitySettings, progress: Progress = SILENT
) -> FloatArray:
    """c_j of every block of the grid, float32 (block rows, block columns, C); sum_i gamma_i c_i = 1
    in each.

    Blocks that lie partly or wholly outside the frame take the value of the nearest whole block.
    """
    progress.stage("estimating colour of blocks", settings.repetitions)
    gamma, sums, sigma = frame.gamma, block_sums(frame), sigma_z(frame)
    chromaticity = sums.solved(sigma, gamma)
    if frame.others is not None:
        own = BlockSums(sums.weight, sums.weight * chromaticity)
        chromaticity = (own + frame.others).solved(sigma, gamma)
    if settings.repetitions:
        chromaticity = oriented_medians(chromaticity, settings.repetitions, progress)
    # Medians of single channels leave the constraint's plane (errata). Scaling brings the vectors
    # back. Far off the plane, where estimates are wild (darkness), scaling would blow them up:
    # there the nearest point of the plane is the safe way back.
    scaled = np.empty_like(chromaticity)

    def constrain(rows: slice) -> None:
        total = (chromaticity[rows] @ gamma)[..., None]
        projected = chromaticity[rows] + (1 - total) * gamma / (gamma @ gamma)
        inside = chromaticity[rows] / np.maximum(total, _LEAST_TOTAL)
        scaled[rows] = np.where(total > _LEAST_TOTAL, inside, projected)

    in_strips(constrain, len(scaled), BLOCK_ROWS)
    return frame.sites.grid.extend(scaled.astype(np.float32))


def block_sums(frame: Frame) -> BlockSums:
    """The sums of Eqs. 8-9 of each whole block."""
    shape = *frame.sites.shape, len(frame.gamma)
    weight, product, signal = np.zeros(shape), np.zeros(shape), frame.signal

    def work(rows: slice) -> None:
        for channel, place in zip(frame.sites.channels, frame.sites.at(rows), strict=True):
            filled = frame.luminance[place].astype(np.float64)
            weight[rows, :, channel] += filled**2
            product[rows, :, channel] += filled * signal[place]

    in_strips(work, len(weight), BLOCK_ROWS)
    return BlockSums(weight, product)


def sigma_z(frame: Frame) -> float:
    """sigma_z of Eqs. 8-9, scene units: the noise of all channels at the mean sample of the whole
    blocks.

    An estimate counts as no noise here: texture raises it, and single scenes would fade.
    """
    if frame.estimated or (noise := frame.noise) is None:
        return _LEAST_SIGMA
    level = float(np.mean([frame.signal[place].mean() for place in frame.sites.places]))
    variances = [noise.sigma(level, plane) ** 2 for plane in range(len(frame.gamma))]
    return max(float(np.mean(variances)) ** 0.5, _LEAST_SIGMA)


def oriented_medians(
    chromaticity: DoubleArray, repetitions: int, progress: Progress = SILENT
) -> DoubleArray:
    """Replace each vector by the nearest of its medians of five along four orientations, and repeat
    until nothing changes.

    Parameters
    ----------
    chromaticity : DoubleArray
        (rows, columns, C), the coarse image, mirrored at its border. Channels are filtered one by
        one.
    repetitions : int
        Largest number of repetitions.
    """
    wide = np.pad(chromaticity.transpose(2, 0, 1), ((0, 0), (0, 0), (2, 2)), mode=BORDER)
    before, changed = np.ascontiguousarray(wide), np.ones(len(chromaticity), np.bool_)
    after = np.empty_like(before)
    for _ in range(repetitions):
        if not changed.any():
            break
        changes = np.zeros_like(changed)
        oriented_median(before, after, changed, changes)
        before, after, changed = after, before, changes
        progress.advance()
    return np.ascontiguousarray(before[:, :, 2:-2].transpose(1, 2, 0))


Lines = tuple[Doubles1, Doubles1, Doubles1, Doubles1]
"""Samples of the other four of five blocks in a line, in order."""


@parallel_kernel()
def oriented_median(
    chunks: Chunks, before: Doubles3, after: Doubles3, changed: Bools1, changes: Bools1
) -> None:
    """Replace each vector by whichever of its four oriented medians of five is nearest to it.

    Parameters
    ----------
    before : Doubles3
        (C, rows, 2 + columns + 2), with mirrored columns.
    after : Doubles3
        Same shape, written, with mirrored columns.
    changed : Bools1
        bool (rows,), rows of `before` that the previous step changed; rows that see none of them
        are copied.
    changes : Bools1
        bool (rows,), set for the rows that this one changes.
    """
    channels, rows, width = before.shape
    columns = width - 4
    medians = np.empty((channels, columns))
    distance, nearest = np.empty(columns), np.empty(columns)
    for row in range(chunks[0], chunks[1]):
        near = np.array([mirrored(row + step, rows) for step in range(-2, 3)])
        for channel in range(channels):
            after[channel, row] = before[channel, row]
        if not changed[near].any():
            continue
        nearest[:] = np.inf
        for down, across in ORIENTATIONS:
            distance[:] = 0.0
            for channel in range(channels):
                plane = before[channel]
                a, b = plane[near[2 - 2 * down]], plane[near[2 - down]]
                d, e = plane[near[2 + down]], plane[near[2 + 2 * down]]
                others = a[2 - 2 * across :], b[2 - across :], d[2 + across :], e[2 + 2 * across :]
                _median_of_five(plane[row, 2:], others, medians[channel], distance)
            for channel in range(channels):
                _take_nearer(medians[channel], distance, nearest, after[channel, row, 2:])
            for column in range(columns):
                nearest[column] = min(nearest[column], distance[column])
        for channel in range(channels):
            changes[row] |= (after[channel, row] != before[channel, row]).any()
            mirror_ends(after[channel, row], 2)


@kernel
def _median_of_five(c: Doubles1, others: Lines, out: Doubles1, distance: Doubles1) -> None:
    """Write medians and add the squares of their distances from c, the middle.

    Neither the least nor the greatest of a, b, c and d can be the median.
    """
    a, b, d, e = others
    for column in range(len(out)):
        low = max(min(a[column], b[column]), min(c[column], d[column]))
        high = min(max(a[column], b[column]), max(c[column], d[column]))
        median = max(min(e[column], low), min(max(e[column], low), high))
        distance[column] += (median - c[column]) ** 2
        out[column] = median


@kernel
def _take_nearer(median: Doubles1, distance: Doubles1, nearest: Doubles1, chosen: Doubles1) -> None:
    for column in range(len(distance)):
        chosen[column] = median[column] if distance[column] < nearest[column] else chosen[column]
