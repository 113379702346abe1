"""A picture in cells of K x K pixels: what the network sees of it, where it may correct, and what its correction does to pixels.

Colour has two components, perpendicular to (1, 1, 1): a correction in these directions keeps luminance, the sum of the channels.
Inputs are in units of local activity: the contrast of luminance and colour around a cell, with what the render misses at the sites.
A correction is in units of a bound, the contrast of colour: a place that has one colour, grey or another, is left alone.
"""

import numpy as np

from ..parts import DARK
from .arrays import Floats1, Floats2, Floats3, Frozen2, Frozen3, Ints1, Pair, Scalar
from .compile import Pieces, kernel, parallel_kernel
from .functions import zeros

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
