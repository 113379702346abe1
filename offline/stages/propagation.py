"""Initial chromaticity of every pixel: a convex combination of the four blocks around it (section 3.3, Eqs. 10 and 14).

Chromaticity of every pixel from the four blocks at the corners of its patch (Eqs. 10 and 14), and its colour (Eq. 17).
"""

from dataclasses import dataclass

import numpy as np

from shared.arrays import FloatArray
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..measured import Measured
from ..numerics.arrays import Floats1, Floats2, Floats3, Ints1, Pair, Scalar
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import unset, zeros
from ..numerics.lanes import WIDTH, Lanes, greater, load, quotient, store, where_less
from ..parts import Look, Part, RowStage
from ..stage import Finite, StageSettings
from ..tiling import core_patches, domain_places, patches_of
from .affinity import CLASSES, AffinitySettings, solve_affinities


@dataclass(frozen=True)
class PropagationSettings(StageSettings):
    """Mixing the chromaticities of the four blocks around a pixel, Eqs. 10 and 14.

    A block's weight is (alpha + softness)^2 l / (1 + likeness d^2), in the paper alpha^2 l, with l the luminance at the block, and
    d the difference of the pixel's from it, over their sum. More softness makes gradients of colour smoother, more likeness prefers
    blocks as bright as the pixel; both 0 or more.
    """

    softness: Finite = 0.0
    likeness: Finite = 0.0


_BYTES, _CHANNEL = 48.0, 28.0  # per pixel (four fields), and per channel of it (the same rows at several stages): measured


@dataclass(eq=False)
class Propagation(RowStage):
    """Spread the chromaticity of the blocks of a frame to its pixels (Eqs. 10-14)."""

    measured: Measured
    affinity: AffinitySettings
    settings: PropagationSettings
    progress: Progress = SILENT

    name = "propagation"
    kernels = "solve_regions", "mix"

    @property
    def look(self) -> Look:
        """No rows around, but whole rows of cores (`tiling`)."""
        grid = self.measured.grid
        return Look(step=core_patches(grid.period)[0] * grid.period, origin=-grid.padding[0][0])

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return (_BYTES + _CHANNEL * channels) * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with a chromaticity that does not depend on the part's.

        Raises ConvergenceError when conjugate gradients do not reach their tolerance.
        """
        luminance, pattern = self.measured.luminance, self.measured.pattern
        fields = solve_affinities(luminance, pattern, self.affinity, rows, self.progress)  # alpha, Eqs. 11-13
        colour = propagate(self.measured.blocks, fields, luminance, pattern, self.settings, rows)  # c, Eqs. 10 and 14
        return Part(rows[0], part.rows(*rows).luminance, colour)


def propagate(
    blocks: FloatArray,
    affinity: FloatArray,
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: PropagationSettings,
    rows: tuple[int, int] | None = None,
) -> FloatArray:
    """c[n] of some rows of the frame, float32 (rows, W, C).

    blocks: chromaticity of every block of the frame, (block rows, block columns, C).
    affinity: the fields that `solve_affinities` returns for the same rows.
    luminance: (H, W), the whole frame.
    rows: first and end; None = all.
    """
    height, width = luminance.shape
    top, bottom = rows or (0, height)
    grid = pattern.grid((height, width))
    (above, _), (left, _) = grid.padding
    fields, first = affinity.reshape(4, *affinity.shape[2:]), patches_of(grid, (top, bottom))[0]
    out = np.empty((bottom - top, width, blocks.shape[-1]), np.float32)
    weighting = settings.softness, settings.likeness
    mix(fields, blocks, luminance, domain_places(grid), first, (top + above - first * grid.period, left), weighting, out)
    return out


_ZERO, _ONE, _MINUS, _QUARTER = np.float32(0), np.float32(1), np.float32(-1), np.float32(0.25)
_LEAST = np.finfo(np.float32).tiny

Places = tuple[Ints1, Ints1]
Weighting = tuple[Scalar, Scalar]
"""(softness, likeness), see `PropagationSettings`."""


@parallel_kernel(pieces=lambda fields, blocks, *_: fields.shape[1] * (blocks.shape[1] - 1) // fields.shape[2])
def mix(
    pieces: Pieces,
    fields: Floats3,
    blocks: Floats3,
    luminance: Floats2,
    places: Places,
    first: int,
    corner: Pair,
    weighting: tuple[float, float],
    out: Floats3,
) -> None:
    """Compute the chromaticities of some rows of the frame (Eqs. 10 and 14).

    fields: (4, pixel rows, domain columns), the fields of whole rows of patches.
    blocks: (block rows, block columns, C), all blocks of the grid.
    luminance: (H, W), the whole frame.
    places: the frame's row at each row of the domain, and its column at each column.
    first: index of the first row of patches in `fields`.
    corner: row of `fields` and domain column that belong to out[0, 0].
    weighting: softness and likeness; see `PropagationSettings`.
    out: (rows, W, C), written.
    """
    softness, likeness = np.float32(weighting[0]), np.float32(weighting[1])
    across = blocks.shape[1] - 1
    period = fields.shape[2] // across
    channels = blocks.shape[2]
    width = fields.shape[2] + WIDTH
    for patch in range(pieces[0], pieces[1]):
        # A class is at the same corner in every second patch only, so its light and chromaticity are stored for every column.
        light, colour = unset(CLASSES, width), unset(CLASSES + 1, channels, width)
        _expand(blocks, luminance, places, first + patch, period, light, colour)
        alpha, line, here = unset(CLASSES, width), unset(channels, width), zeros(width)
        start = max(patch * period - corner[0], 0)
        for row in range(start, min((patch + 1) * period - corner[0], len(out))):
            for kind in range(CLASSES):
                source = fields[kind, row + corner[0]]
                for column in range(len(source)):
                    alpha[kind, column] = source[column]
            if likeness > _ZERO:
                place = places[0][first * period + row + corner[0]]
                for column in range(fields.shape[2]):
                    here[column] = max(luminance[place, places[1][column]], _ZERO)
            _mix_row(alpha, fields.shape[2], light, colour, here, (softness, likeness), line)
            for channel in range(channels):
                mixed = line[channel, corner[1] :]
                for column in range(out.shape[1]):
                    out[row, column, channel] = mixed[column]


@kernel
def _expand(blocks: Floats3, luminance: Floats2, places: Places, patch: int, period: int, light: Floats2, colour: Floats3) -> None:
    """Repeat light and colour of each class's corner over its patch; the last plane of `colour` is the mean of the four corners."""
    rows, columns = places
    one = load(np.ones(WIDTH, np.float32), 0)
    for across in range(blocks.shape[1] - 1):
        left, right = across * period, (across + 1) * period
        for kind in range(CLASSES):
            down, over = _corner(kind, patch, across)
            sample = luminance[rows[patch * period + down * (period - 1)], columns[left + over * (period - 1)]]  # l[n_j]
            for column in range(left, right, WIDTH):  # what runs over the end is written again, with the next patch
                store(light, (kind, column), max(sample, _ZERO) * one)
        for channel in range(blocks.shape[2]):
            mean = _ZERO
            for kind in range(CLASSES):
                down, over = _corner(kind, patch, across)
                value = blocks[patch + down, across + over, channel]
                mean += _QUARTER * value
                for column in range(left, right, WIDTH):
                    store(colour, (kind, channel, column), value * one)
            for column in range(left, right, WIDTH):
                store(colour, (CLASSES, channel, column), mean * one)


@kernel
def _corner(kind: int, patch: int, across: int) -> Pair:
    """Which corner of a patch a class is at: 0 or 1 down, 0 or 1 to the right."""
    return (kind // 2 - patch) % 2, (kind % 2 - across) % 2


@kernel
def _mix_row(
    alpha: Floats2, columns: int, light: Floats2, colour: Floats3, here: Floats1, weighting: Weighting, line: Floats2
) -> None:
    for column in range(0, columns, WIDTH):
        kappa0, kappa1, kappa2, kappa3 = (
            _kappa(alpha, light, here, 0, column, weighting), _kappa(alpha, light, here, 1, column, weighting),
            _kappa(alpha, light, here, 2, column, weighting), _kappa(alpha, light, here, 3, column, weighting),
        )  # fmt: skip
        total = kappa0 + kappa1 + kappa2 + kappa3
        share = quotient(_ONE, total)
        for channel in range(colour.shape[1]):
            mixed = (
                kappa0 * load(colour, (0, channel, column))
                + kappa1 * load(colour, (1, channel, column))
                + kappa2 * load(colour, (2, channel, column))
                + kappa3 * load(colour, (3, channel, column))
            )  # Eq. 10
            # Where no corner has light, all count the same.
            plain = load(colour, (CLASSES, channel, column))
            store(line, (channel, column), where_less(_LEAST, total, mixed * share, plain))


@kernel
def _kappa(alpha: Floats2, light: Floats2, here: Floats1, kind: int, column: int, weighting: Weighting) -> Lanes:
    """The weight of Eq. 14, before the four are scaled to a sum of one."""
    softness, likeness = weighting
    part, lit = load(alpha, (kind, column)), load(light, (kind, column))
    part = softness + greater(part, _MINUS * part)  # |alpha|: of alpha^2 the sign does not count, and the solver leaves none
    if likeness > _ZERO:
        own = load(here, column)
        apart, both = own - lit, own + lit
        lit *= quotient(both * both, both * both + likeness * (apart * apart) + _LEAST)
    return part * part * lit


@parallel_kernel()
def colour(pieces: Pieces, chromaticity: Floats3, luminance: Floats2, out: Floats3) -> None:
    """Multiply chromaticity (H, W, C) by luminance (H, W) to `out` (H, W, C), Eq. 17."""
    for row in range(pieces[0], pieces[1]):
        for column in range(out.shape[1]):
            for channel in range(out.shape[2]):
                out[row, column, channel] = chromaticity[row, column, channel] * luminance[row, column]
