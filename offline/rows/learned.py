"""Correction of chromaticity by a network that was trained on photographs, for what one block in K x K pixels cannot measure.

The picture is cut into cells, K x K pixels with the block in the middle. The network works on the grid of cells: the pixels of a
cell are its channels (space to depth). It sees luminance, chromaticity, what the render missed at the colour sites before that was
corrected, and the noise there. It returns a correction of chromaticity, and luminance stays. `tools/training/` builds and trains
it; `models/README.md` says on what, and where its limits are.

A file in `models/` is for a block and its mirror images, as the Bayer orders are of RGGB: cells are mirrored on the way in and out.
Frames are processed in tiles of one fixed size at fixed places: threads and bands do not change a bit. Inside a tile the network
runs where it may correct something worth its time (see `boxes`).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from shared.arrays import BoolArray, FloatArray, IndexArray, mirrored
from shared.errors import InputError
from shared.networks import Block, load_network, network_for
from shared.pattern import CfaPattern

from ..blocks import Sites
from ..kernels.cells import MARGIN, STATE, SURROUNDINGS, correct_cells, describe, survey
from ..kernels.pieces import copied, in_pieces
from ..measured import BlockSamples
from ..parts import Look, Part, RowStage

REACH = "panchroma.reach"
"""The metadata of a file that says how many cells around a cell the network sees."""
MOST_REACH = 5
"""The most that it may be: what a stage looks at is known before its network is loaded."""
_TILE = 48  # cells along the side of a tile: smaller ones see more of their surroundings, larger ones leave the processor's cache
_FAINT = np.float32(0.01)  # share of luminance that no correction is worth; none is worth less than noise. Measured: loses nothing
_NETWORK = 90 * 2**20  # bytes, with its runtime and the tiles that are at work: measured
_BYTES = 9.0  # per pixel of the rows that are held, and per channel of them: measured
UNKNOWN = 1e6
"""Variance, in scene units squared, of a sample that is not trusted: far above any light. Nothing around it is corrected."""


@dataclass(frozen=True)
class Cells:
    """The cells of a frame, and their way to and from the orientation that the network knows.

    Mirrored, a block has as many pixels of its cell before it as behind it, or one less.

    period: K.
    origin: frame row and column at which the first cell begins, 0 or less.
    shape: number of cells (down, across).
    blocks: index of the first cell (down, across) with a whole block.
    steps: 1, or -1 along an axis that is mirrored.
    channels: the pattern's indices of red, green and blue.
    sites: indices of the sites of a block, in their order in the mirrored block: R, G, G, B.
    """

    period: int
    origin: tuple[int, int]
    shape: tuple[int, int]
    blocks: tuple[int, int]
    steps: tuple[int, int]
    channels: list[int]
    sites: list[int]

    @classmethod
    def of(cls, sites: Sites) -> "Cells":
        """The cells of a frame with channels R, G and B."""
        pattern, grid, period = sites.pattern, sites.grid, sites.grid.period
        steps = Block.of(pattern).steps
        # Pixels of a cell before its block.
        margin = [(period - size + (step < 0)) // 2 for size, step in zip(grid.block_shape, steps, strict=True)]
        origin = [-((before - first) % period) for before, first in zip(margin, pattern.block_origin, strict=True)]
        count = [-(-(size - start) // period) for size, start in zip(grid.frame, origin, strict=True)]
        whole = [
            (int(places[0]) - before - start) // period
            for places, before, start in zip((grid.whole_rows, grid.whole_columns), margin, origin, strict=True)
        ]
        numbers = np.full(grid.block_shape, -1)
        for number, (row, column, _) in enumerate(pattern.sites):
            numbers[row, column] = number
        order = numbers[:: steps[0], :: steps[1]]
        return cls(
            period,
            (origin[0], origin[1]),
            (count[0], count[1]),
            (whole[0], whole[1]),
            steps,
            [pattern.channels.index(letter) for letter in "RGB"],
            order[order >= 0].tolist(),
        )

    def picture(self, part: Part, gamma: FloatArray, rows: tuple[int, int], columns: tuple[int, int], height: int) -> FloatArray:
        """gamma_i times channel i of these rows and columns of cells, float32 (3, rows K, columns K); the frame is mirrored out.

        part: all rows of the frame that the cells show. height: rows of the frame.
        """
        place = np.ix_(*self.places(part, rows, columns, height))
        light, colour = part.luminance[place], part.chromaticity[place]
        planes = np.empty((len(self.channels), *light.shape), np.float32)
        for plane, channel in zip(planes, self.channels, strict=True):
            np.multiply(colour[..., channel], light, out=plane)
        planes *= gamma[self.channels, None, None]
        return planes

    def places(self, part: Part, rows: tuple[int, int], columns: tuple[int, int], height: int) -> tuple[IndexArray, IndexArray]:
        """Row and column in a part of the pixels of these rows and columns of cells; the frame is mirrored out."""
        down = mirrored(self._pixels(0, rows), height).clip(part.first, part.end - 1) - part.first
        across = mirrored(self._pixels(1, columns), part.luminance.shape[1])
        return np.ascontiguousarray(down[:: self.steps[0]]), np.ascontiguousarray(across[:: self.steps[1]])

    def own_places(self, shown: Part, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[IndexArray, IndexArray]:
        """As `places`, but -1 outside a part and outside the frame."""
        down, across = (self._pixels(axis, span)[:: self.steps[axis]] for axis, span in enumerate((rows, columns)))
        inside = (across >= 0) & (across < shown.luminance.shape[1])
        return np.where((down >= shown.first) & (down < shown.end), down - shown.first, -1), np.where(inside, across, -1)

    def blocks_of(self, values: FloatArray, rows: tuple[int, int], columns: tuple[int, int], outside: float) -> FloatArray:
        """Values of whole blocks, (rows, columns, n), at these rows and columns of cells, float32 (n, rows, columns)."""
        down, across = (np.arange(*span) - first for span, first in zip((rows, columns), self.blocks, strict=True))
        inside = (((down >= 0) & (down < values.shape[0]))[:, None]) & ((across >= 0) & (across < values.shape[1]))
        found = values[np.ix_(down.clip(0, values.shape[0] - 1), across.clip(0, values.shape[1] - 1))]
        found = np.where(inside[..., None], found, np.float32(outside)).transpose(2, 0, 1)
        return np.ascontiguousarray(found[:, :: self.steps[0], :: self.steps[1]])

    def _pixels(self, axis: int, span: tuple[int, int]) -> IndexArray:
        return self.origin[axis] + np.arange(span[0] * self.period, span[1] * self.period)


@dataclass(eq=False)
class Learned(RowStage):
    """Correct chromaticity by a network.

    path: one of `models/`. Raises InputError, when it is first needed, if the file cannot be read.
    samples: of a frame whose pattern has the network's block and period.
    gamma: (C,), the weights of Eq. 7.
    """

    path: Path
    samples: BlockSamples
    gamma: FloatArray

    name = "learned"
    kernels = "survey", "describe", "correct_cells"

    @property
    def look(self) -> Look:
        """A tile, and what the network sees around it."""
        period, cells = self.samples.sites.grid.period, Cells.of(self.samples.sites)
        return Look((MOST_REACH + MARGIN + 1) * period, _TILE * period, cells.origin[0])

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels: the picture before and after it, the network, its runtime and the tiles that are at work."""
        return _NETWORK + _BYTES * (1 + channels) * pixels

    @cached_property
    def _reach(self) -> int:
        """Cells around a cell that the network sees. Raises InputError for more than `MOST_REACH`."""
        reach = int(load_network(self.path).get_modelmeta().custom_metadata_map[REACH])
        if reach > MOST_REACH:
            raise InputError(f"{self.path}: the network sees {reach} cells around a cell, expected {MOST_REACH} at most")
        return reach

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows with their chromaticity corrected; they end where tiles do."""
        cells, session, reach = Cells.of(self.samples.sites), load_network(self.path), self._reach
        inputs, halo, size = Inputs(cells, part, self.samples, self.gamma), reach + MARGIN, _TILE * cells.period
        first, last = ((row - cells.origin[0]) // size for row in (rows[0], rows[1] - 1))
        channels, gamma, picture = np.array(cells.channels), self.gamma[cells.channels], (part.luminance, part.chromaticity)
        shown = part.rows(*rows)
        chromaticity = copied(shown.chromaticity)

        def work(tile: tuple[int, int]) -> None:
            down, across = ((each * _TILE - halo, (each + 1) * _TILE + halo) for each in tile)
            error, variance = inputs.blocks(down, across)
            places, own = inputs.places(down, across), cells.own_places(shown, down, across)
            planes, state = (np.zeros((count, *variance.shape), np.float32) for count in (3 * cells.period**2, STATE))
            survey(*picture, places, channels, gamma, error, variance, planes, state)
            state[4] *= inputs.doubt(down, across)
            worth = np.maximum(_FAINT * state[5], np.sqrt(variance))
            for top, left, height, width in boxes((state[4] > worth)[halo:-halo, halo:-halo], reach):
                place = halo + top, halo + left
                seen = np.empty((1, len(planes) + len(error) + SURROUNDINGS, height + 2 * reach, width + 2 * reach), np.float32)
                describe(planes, state, error, variance, (place[0] - reach, place[1] - reach), seen[0])
                (found,) = session.run(None, {"features": seen})
                correct_cells(found[0], planes, state, place, shown.luminance, own, channels, gamma, chromaticity)

        tiles = [(down, across) for down in range(first, last + 1) for across in range(-(-cells.shape[1] // _TILE))]
        in_pieces(lambda first, _: work(tiles[first]), len(tiles))
        return replace(shown, chromaticity=chromaticity)


def boxes(wanted: BoolArray, reach: int) -> list[tuple[int, int, int, int]]:
    """Cover what is wanted of a tile by boxes (first row and column, rows, columns) that together cost little to compute.

    The smallest box around it is cut in two where that saves most, and so are the parts.
    reach: cells around a box that are computed for its sake; the layers of a network need half of them on average.
    """
    down, across = np.flatnonzero(wanted.any(axis=1)), np.flatnonzero(wanted.any(axis=0))
    if not down.size:
        return []
    top, left, height, width = int(down[0]), int(across[0]), int(down[-1] - down[0]) + 1, int(across[-1] - across[0]) + 1
    inside = wanted[top : top + height, left : left + width]
    (by_rows, row), (by_columns, column) = _best_cut(inside, reach), _best_cut(inside.T, reach)
    if min(by_rows, by_columns) >= (height + reach) * (width + reach):
        return [(top, left, height, width)]
    row, column = (row, 0) if by_rows <= by_columns else (0, column)
    first = boxes(inside[:row] if row else inside[:, :column], reach)
    second = boxes(inside[row:, column:], reach)
    moved = [(y + row, x + column, *size) for y, x, *size in second]
    return [(top + y, left + x, height, width) for y, x, height, width in (*first, *moved)]


def _best_cut(wanted: BoolArray, reach: int) -> tuple[float, int]:
    """The least cost of two boxes around what is wanted in the rows above a cut and below it, and the first row below it."""
    rows = np.flatnonzero(wanted.any(axis=1))
    if rows.size < 2:
        return np.inf, 0
    first, end = wanted[rows].argmax(axis=1), wanted.shape[1] - wanted[rows, ::-1].argmax(axis=1)
    costs = np.zeros(rows.size - 1)
    for side, to in ((slice(None), rows[:-1] - rows[0]), (slice(None, None, -1), rows[-1] - rows[:0:-1])):
        width = np.maximum.accumulate(end[side]) - np.minimum.accumulate(first[side])
        costs += ((to + 1 + reach) * (width[:-1] + reach))[side]
    best = int(costs.argmin())
    return float(costs[best]), int(rows[best + 1])


class Inputs:
    """What the network sees of a part of a picture.

    part: the picture, with what it missed before it was corrected.
    gamma: (C,), float32.
    """

    def __init__(self, cells: Cells, part: Part, samples: BlockSamples, gamma: FloatArray) -> None:
        self._cells, self._part, self._gamma, self._height = cells, part, gamma, samples.sites.grid.frame[0]
        rows = samples.within(part)
        self._error = samples.missed(part, rows)[..., cells.sites]
        noise = samples.scaled_variance(gamma, rows)
        known = np.zeros(self._error.shape[:2], np.float32) if noise is None else noise.mean(axis=2)
        self._variance = np.where(samples.unclipped[rows], known, np.float32(UNKNOWN))[..., None]
        # In photographs the network also corrects what a line explains, in print lines are certain: 8 costs 0.02 dB.
        lines = samples.lines
        self._doubt = np.ones_like(self._variance) if lines is None else 1 - lines.share[rows, :, None] ** 32
        self._blocks = replace(cells, blocks=(cells.blocks[0] + rows.start, cells.blocks[1]))

    def blocks(self, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """What the S sites of these rows and columns of cells miss, (S, rows, columns), and the variance of the noise in it.

        Cells may lie outside the frame.
        """
        error = self._blocks.blocks_of(self._error, rows, columns, 0.0)
        return error, self._blocks.blocks_of(self._variance, rows, columns, UNKNOWN)[0]

    def doubt(self, rows: tuple[int, int], columns: tuple[int, int]) -> FloatArray:
        """How far the colour lines are not believed in these rows and columns of cells, 0 to 1, (rows, columns)."""
        return self._blocks.blocks_of(self._doubt, rows, columns, 1.0)[0]

    def places(self, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[IndexArray, IndexArray]:
        """See `Cells.places`."""
        return self._cells.places(self._part, rows, columns, self._height)

    def picture(self, rows: tuple[int, int], columns: tuple[int, int]) -> FloatArray:
        """See `Cells.picture`."""
        return self._cells.picture(self._part, self._gamma, rows, columns, self._height)


def network_name(pattern: CfaPattern) -> str | None:
    """The name of the network that corrects colour for a pattern, in the preset BEST; None if there is none for it.

    >>> from offline import network_name
    >>> from shared import CfaPattern
    >>> network_name(CfaPattern.bayer(6)), network_name(CfaPattern.bayer(7))
    ('rggb-k6', None)
    """
    path = network_for(pattern)
    return path.stem if path else None
