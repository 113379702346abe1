"""Correction of chromaticity by a network that was trained on photographs, for what one block in K x K pixels cannot measure.

The picture is cut into cells, K x K pixels with the block in the middle. The network works on the grid of cells: the pixels of a
cell are its channels (space to depth). It sees luminance, chromaticity, what the render missed at the colour sites before that was
corrected, and the noise there. It returns a correction of chromaticity, and luminance stays. `tools/training/` builds and trains
it; `models/README.md` says on what, and where its limits are.

A file in `models/` is for a block and its mirror images, as the Bayer orders are of RGGB: cells are mirrored on the way in and out.
Frames are processed in tiles of one fixed size at fixed places: threads and bands do not change a bit. Inside a tile the network
runs where it may correct something worth its time (see `boxes`).

A picture in cells of K x K pixels: what the network sees of it, where it may correct, and what its correction does to pixels.

Colour has two components, perpendicular to (1, 1, 1): a correction in these directions keeps luminance, the sum of the channels.
Inputs are in units of local activity: the contrast of luminance and colour around a cell, with what the render misses at the sites.
A correction is in units of a bound, the contrast of colour: a place that has one colour, grey or another, is left alone.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from shared.arrays import BoolArray, FloatArray, IndexArray, mirrored
from shared.errors import InputError
from shared.networks import Block, load_network, network_for
from shared.pattern import CfaPattern

from ..frame import Sites
from ..measured import BlockSamples
from ..numerics.arrays import Floats1, Floats2, Floats3, Frozen2, Frozen3, Ints1, Pair, Scalar
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import zeros
from ..numerics.pieces import copied, in_pieces
from ..parts import DARK, Look, Part, RowStage

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


STATE = 6
"""Planes of what `survey` finds."""
SURROUNDINGS = 5
"""Planes of what `describe` says of the surroundings of a cell, beside its pixels and sites."""
MARGIN = 2
"""Cells around a cell on which its inputs depend."""
GATE = 0.2
"""Multiple of the noise variance that is taken off the contrast of colour. The networks, trained with 0.8, tell noise from colour
themselves: on 20 photographs 0.2 gains 0.03 dB in noise over 0.8, and loses nothing to 0. What is not known stays: its variance is
above any contrast."""
# Share of luminance in activity; bound of the correction in units of the contrast of colour; and bound of the inputs: as the
# networks were trained with (models/README.md).
_LUMINANCE, _EVIDENCE, _RANGE = np.float32(0.25), np.float32(4), np.float32(8)
_LEAST_LIGHT, _LEAST_ACTIVITY = np.float32(1e-4), np.float32(1e-30)  # scene units, and squared: they keep quotients finite
# The share of mean luminance, and the scene units, below which a pixel's own chromaticity tells little. Chosen.
_DIM, _LEAST_DIM = np.float32(0.2), np.float32(1e-5)
_DARK = np.float32(DARK)
_THIRD, _HALF, _SIXTH = np.float32(1 / 3), np.float32(np.sqrt(1 / 2)), np.float32(np.sqrt(1 / 6))
_ZERO, _ONE, _TWO, _LOG = np.float32(0), np.float32(1), np.float32(2), np.float32(0.3)

Places = tuple[Ints1, Ints1]


def _one(*_: object) -> int:
    return 1


@parallel_kernel(pieces=_one)
def survey(
    pieces: Pieces,
    light: Frozen2,
    chromaticity: Frozen3,
    places: Places,
    channels: Ints1,
    gamma: Floats1,
    error: Floats3,
    variance: Floats2,
    cells: Floats3,
    state: Floats3,
) -> None:
    """Cut a picture into cells, and find how far each may be corrected; the outermost `MARGIN` cells are not judged.

    light, chromaticity: (H, W) and (H, W, C), scene units.
    places: the picture's row at each row of the h x w cells, (h K,), and its column at each column, (w K,).
    channels: indices of red, green and blue. gamma: their weights in Eq. 7.
    error: (S, h, w), what the S sites of a cell miss. variance: (h, w), of the noise in that.
    cells: (3 K^2, h, w), written: luminance of all pixels of a cell, then the two components of colour.
    state: (STATE, h, w), written: mean luminance around, means of the two components there over that, activity, bound, and the
        mean luminance of the cell itself.
    """
    pixels, (height, width) = len(cells) // 3, state.shape[1:]
    _cut(light, chromaticity, places, channels, gamma, cells)
    means, contrasts = zeros(3, height, width), zeros(2, height, width)
    for plane in range(3):
        for pixel in range(pixels):
            for row in range(height):
                for column in range(width):
                    means[plane, row, column] += cells[plane * pixels + pixel, row, column] / np.float32(pixels)
    for row in range(height):
        for column in range(width):
            state[5, row, column] = means[0, row, column]
    for row in range(1, height - 1):
        for column in range(1, width - 1):
            state[0, row, column] = _around(means[0], row, column)
            positive = max(state[0, row, column], _LEAST_LIGHT)
            state[1, row, column] = _around(means[1], row, column) / positive
            state[2, row, column] = _around(means[2], row, column) / positive
            for site in range(len(error)):
                contrasts[0, row, column] += error[site, row, column] ** 2 / np.float32(len(error))
    for pixel in range(pixels):
        for row in range(1, height - 1):
            for column in range(1, width - 1):
                lit = cells[pixel, row, column]
                plain = lit - state[0, row, column]
                first = cells[pixels + pixel, row, column] - lit * state[1, row, column]
                second = cells[2 * pixels + pixel, row, column] - lit * state[2, row, column]
                contrasts[0, row, column] += (first * first + second * second) / np.float32(2 * pixels)
                contrasts[1, row, column] += plain * plain / np.float32(pixels)
    for row in range(MARGIN, height - MARGIN):
        for column in range(MARGIN, width - MARGIN):
            evidence = _around(contrasts[0], row, column)
            scale = np.sqrt(max(evidence + _LUMINANCE * _around(contrasts[1], row, column), _LEAST_ACTIVITY))
            beyond = max(evidence - np.float32(GATE) * _around(variance, row, column), _ZERO)
            state[3, row, column] = scale
            state[4, row, column] = min(scale, _EVIDENCE * np.sqrt(beyond))


@kernel
def _cut(light: Floats2, chromaticity: Floats3, places: Places, channels: Ints1, gamma: Floats1, cells: Floats3) -> None:
    """Write light and colour of each pixel to its cell."""
    (down, across), (red, green, blue), pixels = places, (channels[0], channels[1], channels[2]), len(cells) // 3
    period = len(down) // cells.shape[1]
    for row in range(cells.shape[1]):
        for pixel in range(pixels):
            line, right = down[row * period + pixel // period], pixel % period
            for column in range(cells.shape[2]):
                place = across[column * period + right]
                lit = light[line, place]
                r, g, b = (
                    chromaticity[line, place, red] * lit * gamma[0],
                    chromaticity[line, place, green] * lit * gamma[1],
                    chromaticity[line, place, blue] * lit * gamma[2],
                )
                cells[pixel, row, column] = (r + g + b) * _THIRD
                cells[pixels + pixel, row, column] = (r - g) * _HALF
                cells[2 * pixels + pixel, row, column] = (r + g - _TWO * b) * _SIXTH


@kernel
def _around(plane: Floats2, row: int, column: int) -> Scalar:
    """The mean of 3 x 3 cells."""
    total = _ZERO
    for y in range(row - 1, row + 2):
        total += plane[y, column - 1] + plane[y, column] + plane[y, column + 1]
    return total / np.float32(9)


@parallel_kernel(pieces=_one)
def describe(pieces: Pieces, cells: Floats3, state: Floats3, error: Floats3, variance: Floats2, first: Pair, out: Floats3) -> None:
    """Write what the network sees of the cells from row and column `first` on, `out`, (3 K^2 + S + SURROUNDINGS, rows, columns).

    cells, state, error, variance: see `survey`.
    """
    pixels, (rows, columns) = len(cells) // 3, out.shape[1:]
    last = 3 * pixels + len(error)
    for y in range(rows):
        row = first[0] + y
        for x in range(columns):
            column = first[1] + x
            scale = state[3, row, column]
            for plane in range(2):
                out[last + plane, y, x] = _bounded(state[1 + plane, row, column])
            positive = max(state[0, row, column], _LEAST_LIGHT)
            out[last + 2, y, x] = _bounded(np.log2(_ONE + np.sqrt(variance[row, column]) / scale))
            out[last + 3, y, x] = _bounded(_LOG * np.log2(_ONE + positive / scale))
            out[last + 4, y, x] = _bounded(state[4, row, column] / scale)
        for site in range(len(error)):
            for x in range(columns):
                out[3 * pixels + site, y, x] = _bounded(error[site, row, first[1] + x] / state[3, row, first[1] + x])
        for pixel in range(pixels):
            for x in range(columns):
                column = first[1] + x
                share, lit = _ONE / state[3, row, column], cells[pixel, row, column]
                out[pixel, y, x] = _bounded((lit - state[0, row, column]) * share)
                for plane in range(1, 3):
                    odd = cells[plane * pixels + pixel, row, column] - lit * state[plane, row, column]
                    out[plane * pixels + pixel, y, x] = _bounded(odd * share)


@kernel
def _bounded(value: Scalar) -> Scalar:
    return min(max(value, -_RANGE), _RANGE)


@parallel_kernel(pieces=_one)
def correct_cells(
    pieces: Pieces,
    found: Floats3,
    cells: Floats3,
    state: Floats3,
    first: Pair,
    light: Frozen2,
    places: Places,
    channels: Ints1,
    gamma: Floats1,
    out: Floats3,
) -> None:
    """Add a correction to chromaticity, `out`, (H, W, C). No chromaticity leaves the range of those in the 3 x 3 cells around.

    found: (2 K^2, rows, columns), what the network says of the cells from row and column `first` on, in units of their bounds.
    cells, state, light, channels, gamma: see `survey`. places: as there; -1 = a row or column that is not to be changed.
    """
    (down, across), pixels = places, len(cells) // 3
    period, (rows, columns) = len(down) // cells.shape[1], found.shape[1:]
    ranges = _ranges(cells, state[5], first, rows, columns)
    for y in range(rows):
        row = first[0] + y
        for pixel in range(pixels):
            line, right = down[row * period + pixel // period], pixel % period
            if line < 0:
                continue
            for x in range(columns):
                column = first[1] + x
                place, gain = across[column * period + right], state[4, row, column]
                if place < 0 or gain <= _ZERO or light[line, place] <= _DARK:
                    continue
                safe = _safe(cells[pixel, row, column], state[5, row, column])
                a = _inside(gain * found[pixel, y, x], cells[pixels + pixel, row, column], safe, ranges, 0, y, x)
                b = _inside(gain * found[pixels + pixel, y, x], cells[2 * pixels + pixel, row, column], safe, ranges, 1, y, x)
                r, g, b = a * _HALF + b * _SIXTH, b * _SIXTH - a * _HALF, -_TWO * b * _SIXTH
                # No channel gains or loses more than all light: among pixels below black the network knows no bound.
                most = max(light[line, place], abs(r), abs(g), abs(b))
                out[line, place, channels[0]] += r / (most * gamma[0])
                out[line, place, channels[1]] += g / (most * gamma[1])
                out[line, place, channels[2]] += b / (most * gamma[2])


@kernel
def _safe(light: Scalar, mean: Scalar) -> Scalar:
    """Luminance of a pixel, or what it is taken for where it is too dark for its chromaticity to be known."""
    safe: Scalar = max(light, _DIM * mean, _LEAST_DIM)
    return safe


@kernel
def _inside(value: Scalar, here: Scalar, safe: Scalar, ranges: Floats3, component: int, y: int, x: int) -> Scalar:
    """A correction of a component of colour, `here`, that leads no farther out than chromaticity around allows."""
    low, high = ranges[component, y, x] * safe - here, ranges[2 + component, y, x] * safe - here
    inside: Scalar = min(max(value, min(low, _ZERO)), max(high, _ZERO))
    return inside


@kernel
def _ranges(cells: Floats3, means: Floats2, first: Pair, rows: int, columns: int) -> Floats3:
    """The chromaticities of the 3 x 3 cells around a cell: least of both components, then greatest, (4, rows, columns)."""
    pixels = len(cells) // 3
    each, around = zeros(4, rows + 2, columns + 2), zeros(4, rows, columns)
    for y in range(rows + 2):
        row = first[0] - 1 + y
        for pixel in range(pixels):
            for x in range(columns + 2):
                column = first[1] - 1 + x
                share = _ONE / _safe(cells[pixel, row, column], means[row, column])
                for component in range(2):
                    tint = cells[(1 + component) * pixels + pixel, row, column] * share
                    low, high = each[component, y, x], each[2 + component, y, x]
                    each[component, y, x] = tint if pixel == 0 else min(low, tint)
                    each[2 + component, y, x] = tint if pixel == 0 else max(high, tint)
    for plane in range(4):
        for y in range(rows):
            for x in range(columns):
                found = each[plane, y, x]
                for place in range(1, 9):
                    other = each[plane, y + place // 3, x + place % 3]
                    found = min(found, other) if plane < 2 else max(found, other)
                around[plane, y, x] = found
    return around
