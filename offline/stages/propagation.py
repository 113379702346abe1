"""Initial chromaticity of every pixel: a convex combination of the four blocks around it (section
3.3, Eqs. 10 and 14).

Eq. 10: c[n] = sum_j kappa_j[n] c_j over the four blocks j at the corners of the patch of n. Eq. 14:
kappa_j[n] = alpha_j[n]^2 l[n_j] / sum_i alpha_i[n]^2 l[n_i], with alpha the affinity (Eqs. 11-13)
and l[n_j] the luminance at the corner of the patch that lies in block j. Eq. 17: the colour of a
pixel is its chromaticity times its luminance.

Literally: tests/reference/propagation.py.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...shared.arrays import FloatArray
from ..bands import Band, Halo, RowStage
from ..frame import Frame
from ..numerics.arrays import Floats1, Floats2, Floats3, Frozen2, Single
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.functions import unset
from ..patches import chunk_patches, padded_rows, patches_of
from ..stage import NotNegative, StageSettings
from .affinity import CLASSES, AffinitySettings, solve_affinities


@dataclass(frozen=True)
class PropagationSettings(StageSettings):
    """Mixing the chromaticities of the four blocks around a pixel, Eqs. 10 and 14.

    A block's weight is (alpha + softness)^2 l / (1 + likeness d^2), in the paper alpha^2 l, with l
    the luminance at the block, and d the difference of the pixel's from it, over their sum. More
    softness makes gradients of colour smoother, more likeness prefers blocks as bright as the
    pixel; both 0 or more.
    """

    softness: NotNegative = 0.0
    likeness: NotNegative = 0.0


_SMALLEST_FLOAT = np.finfo(np.float32).tiny
# a pixel beyond the end of a line counts as end + BEYOND (l - end): with more, thin strokes beside
# edges have too pure colours; with less, small type loses colour
BEYOND = np.float32(0.5)
DIMMEST = 0.02  # of the mean luminance: darker pixels have the colour of such on their line


@dataclass(eq=False)
class Propagation(RowStage):
    """Spread the chromaticity of the blocks of a frame to its pixels (Eqs. 10-14)."""

    frame: Frame
    affinity: AffinitySettings
    settings: PropagationSettings

    name = "propagation"

    @property
    def halo(self) -> Halo:
        """No rows around, but whole rows of chunks (`patches`)."""
        grid = self.frame.grid
        rows = chunk_patches(grid.period)[0] * grid.period
        return Halo(alignment=rows, offset=-grid.padding[0][0])

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows, with a chromaticity that does not depend on the band's.

        Raises
        ------
        ConvergenceError
            When conjugate gradients do not reach their tolerance.
        """
        # alpha, Eqs. 11-13
        fields = solve_affinities(self.frame.luminance, self.frame.pattern, self.affinity, rows)
        lit, colour = band.rows(*rows).luminance, self.mixed(fields, rows)
        if self.frame.lines.size:
            along, least = colour, np.float32(DIMMEST * self.frame.level)
            colour = np.empty((*lit.shape, len(self.frame.gamma32)), np.float32)
            follow_lines(along, lit, least, self.frame.gamma32, colour)
        return Band(rows[0], lit, colour)

    def mixed(self, affinity: FloatArray, rows: tuple[int, int]) -> FloatArray:
        """c[n] of some rows of the frame, float32 (rows, W, C), Eqs. 10 and 14; with lines, all
        that is spread.

        Parameters
        ----------
        affinity : FloatArray
            The fields that `solve_affinities` returns for the same rows.
        """
        grid, settings = self.frame.grid, self.settings
        spread = self.frame.lines if self.frame.lines.size else self.frame.blocks
        (above, _), (left, _) = grid.padding
        fields, patches = affinity.reshape(4, *affinity.shape[2:]), patches_of(grid, rows)
        out = np.empty((rows[1] - rows[0], grid.frame[1], spread.shape[-1]), np.float32)
        luminance = np.maximum(padded_rows(self.frame.luminance, grid, patches, 0), 0)
        corner = rows[0] + above - patches[0] * grid.period, left
        weighting = np.float32(settings.softness), np.float32(settings.likeness)
        mix(fields, spread, Mixing(luminance, grid.period, patches[0], *corner, *weighting), out)
        return out


@parallel_kernel()
def follow_lines(
    chunks: Chunks, lines: Floats3, luminance: Frozen2, least: Single, gamma: Floats1, out: Floats3
) -> None:
    """Compute the chromaticities of pixels whose colour is c l + s (l - l_j), a line through that
    of the block. A pixel whose luminance lies beyond an end of the line has the chromaticity of
    half that distance. No channel is below 0.

    Parameters
    ----------
    lines : Floats3
        c + s, s l_j, and the luminances at which the line ends, (rows, W, 2 C + 2).
    luminance : Frozen2
        l, (rows, W).
    least : Single
        Luminance below which l counts as that.
    out : Floats3
        (rows, W, C), written.
    """
    channels = len(gamma)
    for row in range(chunks[0], chunks[1]):
        for column in range(out.shape[1]):
            line, total = lines[row, column], ZERO
            known = max(min(luminance[row, column], line[-1]), line[-2])
            lit = max(known + BEYOND * (luminance[row, column] - known), least)
            for channel in range(channels):
                value = max(line[channel] - line[channels + channel] / lit, ZERO)
                out[row, column, channel] = value
                total += gamma[channel] * value
            for channel in range(channels):
                out[row, column, channel] /= total


class Mixing(NamedTuple):
    """Luminance, places and constants of `mix`.

    Attributes
    ----------
    luminance : Floats2
        Of the same pixels as the fields, 0 or more, scene units.
    period : int
        Pixels of a patch.
    patch : int
        The first row of patches in the fields.
    row, column : int
        Those of the fields that belong to out[0, 0].
    softness, likeness : Single
        See `PropagationSettings`.
    """

    luminance: Floats2
    period: int
    patch: int
    row: int
    column: int
    softness: Single
    likeness: Single


@parallel_kernel(chunks=lambda fields, blocks, mixing, out: fields.shape[1] // mixing.period)
def mix(chunks: Chunks, fields: Floats3, blocks: Floats3, mixing: Mixing, out: Floats3) -> None:
    """Compute the chromaticities of some rows of the frame (Eqs. 10 and 14).

    Parameters
    ----------
    fields : Floats3
        (4, pixel rows, padded columns), the fields of whole rows of patches.
    blocks : Floats3
        (block rows, block columns, C), all blocks of the grid.
    out : Floats3
        (rows, W, C), written.
    """
    (_, _, width), period, channels = fields.shape, mixing.period, blocks.shape[2]
    kappa, total, mixed = unset(CLASSES, width), unset(width), unset(channels, width)
    for patch in range(chunks[0], chunks[1]):
        # A class is at the same corner in every second patch only, so its luminance and
        # chromaticity are stored for every column.
        lines = mixing.luminance[patch * period : (patch + 1) * period]
        lit, colour, mean = _expand(blocks, lines, mixing.patch + patch)
        top = patch * period - mixing.row
        for row in range(max(top, 0), min(top + period, len(out))):
            here = row + mixing.row
            total[:] = ZERO
            for kind in range(CLASSES):
                _weigh(fields[kind, here], lit[kind], here, mixing, kappa[kind], total)
            for column in range(width):
                total[column] = ONE / total[column] if total[column] > _SMALLEST_FLOAT else ZERO
            for channel in range(channels):
                _mix(kappa, colour[channel], mean[channel], total, mixed[channel])
            for channel in range(channels):
                out[row, :, channel] = mixed[channel, mixing.column :][: out.shape[1]]


@kernel
def _expand(blocks: Floats3, luminance: Floats2, patch: int) -> tuple[Floats2, Floats3, Floats2]:
    """Repeat luminance and chromaticity of each class's corner over its patch, and the mean
    chromaticity of the four corners, for a row of patches, whose luminance is given.
    """
    period, count, channels = len(luminance), blocks.shape[1] - 1, blocks.shape[2]
    lit, mean = unset(CLASSES, count * period), unset(channels, count * period)
    colour = unset(channels, CLASSES, count * period)
    for kind in range(CLASSES):
        down = (kind // 2 - patch) % 2  # the corner of a patch that the class is at
        for across in range(count):
            over = (kind % 2 - across) % 2
            pixels = slice(across * period, (across + 1) * period)
            corner = down * (period - 1), across * period + over * (period - 1)
            lit[kind, pixels] = luminance[corner]  # l[n_j]
            for channel in range(channels):
                colour[channel, kind, pixels] = blocks[patch + down, across + over, channel]
    for channel in range(channels):
        a, b = colour[channel, 0], colour[channel, 1]
        c, d, line = colour[channel, 2], colour[channel, 3], mean[channel]
        for column in range(len(line)):
            line[column] = np.float32(0.25) * (a[column] + b[column] + c[column] + d[column])
    return lit, colour, mean


@kernel
def _weigh(
    alpha: Floats1, lit: Floats1, row: int, mixing: Mixing, kappa: Floats1, total: Floats1
) -> None:
    """Write the weights of Eq. 14, not yet scaled to a sum of one, and add them to their total.

    row: of the fields.
    """
    softness, likeness, here = mixing.softness, mixing.likeness, mixing.luminance[row]
    for column in range(len(alpha)):
        weight = softness + abs(alpha[column])
        apart, both = here[column] - lit[column], here[column] + lit[column]
        alike = both * both / (both * both + likeness * (apart * apart) + _SMALLEST_FLOAT)
        kappa[column] = weight * weight * lit[column] * alike
        total[column] += kappa[column]


@kernel
def _mix(kappa: Floats2, colour: Floats2, mean: Floats1, share: Floats1, mixed: Floats1) -> None:
    """Average a channel of the four blocks (Eq. 10). Where all corners are dark, they count the
    same.
    """
    a, b, c, d = kappa[0], kappa[1], kappa[2], kappa[3]
    first, second, third, fourth = colour[0], colour[1], colour[2], colour[3]
    for column in range(len(mixed)):
        value = a[column] * first[column] + b[column] * second[column]
        value = value + c[column] * third[column] + d[column] * fourth[column]
        mixed[column] = value * share[column] if share[column] > ZERO else mean[column]


@parallel_kernel()
def apply_luminance(chunks: Chunks, colour: Floats3, luminance: Floats2, out: Floats3) -> None:
    """Multiply chromaticity (H, W, C) by luminance (H, W) to `out` (H, W, C), Eq. 17."""
    for row in range(chunks[0], chunks[1]):
        for column in range(out.shape[1]):
            lit = luminance[row, column]
            for channel in range(out.shape[2]):
                out[row, column, channel] = colour[row, column, channel] * lit
