"""Channels that are displaced against luminance: how far, what samples would be without it, and pictures with it.

A channel is displaced by (down, across, outwards): it shows what lies so many rows and columns farther, and outwards so many pixels
in the corners, in proportion less towards the middle. So each row has a displacement of its own down, and each column one across.
"""

import numpy as np

from .arrays import Area, Bools2, Doubles1, Doubles2, Doubles3, Doubles4, Floats1, Floats2, Floats3, Ints2, Pair, Scalar, Single
from .compile import Pieces, kernel, parallel_kernel
from .interpolation import Taps, cubic_taps, interpolated

_NONE, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
MOST = np.float32(2)
"""Factor by which a displacement changes a sample or a chromaticity at most: luminance may be filled in."""
# Share of a channel that a displacement has to change: less is lost in the grain of luminance, from where it would be taken along.
# Chosen: half and twice of it cost photographs 0.01 dB.
_FAINT = np.float32(0.01)

Lens = tuple[Doubles1, Doubles2, Doubles2]
"""Weights of Eq. 7, (C,); where each channel sees each row of the frame, (C, H), and each column, (C, W)."""
Blocks = tuple[Floats3, Floats3, Floats3, Bools2]
"""Samples, (rows, columns, S); about the chromaticity, (rows, columns, C); variance of the samples over luminance, (rows, columns,
S), > 0; and whether they measure light, (rows, columns)."""
Grid = tuple[Ints2, int]
"""Row and column in the frame of each site of the first block, and its channel, (S, 3); and the period K."""
Equations = tuple[Doubles3, Doubles3, Doubles2]
"""For each tile, of P unknowns: `normal`, (T, P, P), and `right`, (T, P), the equations for a better displacement; and `steep`, (T,
P, P), by how much `right` changes with the unknowns."""


@parallel_kernel(pieces=lambda luminance, blocks, grid, lens, outward, fill, tiles, *_: len(tiles))
def fringe_equations(
    pieces: Pieces,
    luminance: Floats2,
    blocks: Blocks,
    grid: Grid,
    lens: Lens,
    outward: tuple[Doubles1, Doubles1],
    fill: Doubles1,
    tiles: Ints2,
    side: int,
    least: Single,
    scale: float,
    equations: Equations,
) -> None:
    """Equations for a better displacement, from how the colour of neighbouring blocks differs, of each tile of blocks.

    The unknowns are the displacements, three of each channel, and then by which share luminance under the blocks is too flat, down
    and across.

    luminance: (H, W), scene units. lens, fill: the unknowns so far; fill: (2,).
    outward: how far rows, (H,), and columns, (W,), are from the middle of the frame, in half diagonals.
    tiles: (T, 2), first row and column of blocks of each tile. side: its blocks down and across.
    least: luminance that dark pixels are taken to have, > 0.
    scale: standard deviations from which on a difference counts less.
    equations: written.
    """
    samples, unknowns = blocks[0], 3 * len(lens[0]) + 2
    (rows, columns, sites), normal, steep, right = samples.shape, equations[0], equations[1], equations[2]
    for tile in range(pieces[0], pieces[1]):
        top, left = tiles[tile, 0], tiles[tile, 1]
        down, across = min(side + 1, rows - top), min(side + 1, columns - left)
        seen, known = np.empty((down, across, sites)), np.empty((down, across, sites, unknowns))
        _chromaticities(luminance, blocks, grid, lens, outward, fill, (top, left), least, seen, known)
        normal[tile], steep[tile], right[tile] = 0.0, 0.0, 0.0
        for row in range(min(side, down)):
            for column in range(min(side, across)):
                for step in range(2):
                    if row + step < down and column + 1 - step < across:
                        pair = row, column, row + step, column + 1 - step
                        _compare(blocks, (top, left), pair, scale, seen, known, (normal[tile], steep[tile], right[tile]))
        for i in range(unknowns):
            for j in range(i):
                normal[tile, j, i], steep[tile, j, i] = normal[tile, i, j], steep[tile, i, j]


@kernel
def _chromaticities(
    luminance: Floats2,
    blocks: Blocks,
    grid: Grid,
    lens: Lens,
    outward: tuple[Doubles1, Doubles1],
    fill: Doubles1,
    first: Pair,
    least: Single,
    seen: Doubles3,
    known: Doubles4,
) -> None:
    """What each sample says its chromaticity is, and how much of that each unknown explains. first: row and column of blocks."""
    (samples, colour, _, _), (places, period), gamma = blocks, grid, lens[0]
    (rows, columns, sites), count = seen.shape, len(gamma)
    lights, middle = np.empty((count, 3), np.float32), np.zeros(2)
    for site in range(sites):
        for axis in range(2):
            middle[axis] += places[site, axis] / sites
    for row in range(rows):
        for column in range(columns):
            shares = colour[first[0] + row, first[1] + column]
            for site in range(sites):
                y, x = places[site, 0] + (first[0] + row) * period, places[site, 1] + (first[1] + column) * period
                channel, explains = places[site, 2], known[row, column, site]
                whole = max(_look(luminance, y, x, lens, shares, lights), least)
                own = max(np.float64(lights[channel, 0]), least)
                found = samples[first[0] + row, first[1] + column, site] * whole / (own * max(luminance[y, x], least))
                for each in range(count):
                    part = shares[channel] * ((1 / own if each == channel else 0.0) - gamma[each] * shares[each] / whole)
                    down, across = part * lights[each, 1], part * lights[each, 2]
                    explains[3 * each], explains[3 * each + 1] = down, across
                    explains[3 * each + 2] = down * outward[0][y] + across * outward[1][x]
                for axis in range(2):
                    flat = 2 * (places[site, axis] - middle[axis]) * shares[channel] * lights[channel, 1 + axis] / own
                    explains[3 * count + axis] = flat
                    found -= fill[axis] * flat
                seen[row, column, site] = found


@kernel
def _compare(
    blocks: Blocks,
    first: Pair,
    pair: Area,
    scale: float,
    seen: Doubles3,
    known: Doubles4,
    sums: tuple[Doubles2, Doubles2, Doubles1],
) -> None:
    """Add what two neighbouring blocks say to the equations of a tile. pair: row and column of each in the tile."""
    (_, _, variance, usable), (top, left), (row, column, down, right) = blocks, first, pair
    if not (usable[top + row, left + column] and usable[top + down, left + right]):
        return
    for site in range(seen.shape[2]):
        noise = variance[top + row, left + column, site] + variance[top + down, left + right, site]
        apart = seen[row, column, site] - seen[down, right, site]
        far = apart * apart / (noise * scale * scale)
        weight = 1 / (noise * np.sqrt(1 + far))
        slope = weight / (1 + far)
        one, other = known[row, column, site], known[down, right, site]
        for i in range(len(one)):
            change = one[i] - other[i]
            sums[2][i] += weight * apart * change
            for j in range(i + 1):
                both = change * (one[j] - other[j])
                sums[0][i, j] += weight * both
                sums[1][i, j] += slope * both


@parallel_kernel(pieces=lambda luminance, samples, *_: len(samples))
def without_fringes(
    pieces: Pieces, luminance: Floats2, samples: Floats3, colour: Floats3, usable: Bools2, grid: Grid, lens: Lens, out: Floats3
) -> None:
    """The samples as they would be if no channel were displaced.

    luminance: (H, W), scene units. samples: (rows, columns, S). colour: about the chromaticity of each block, (rows, columns, C).
    usable: blocks that measure light, (rows, columns); the samples of the others stay.
    out: (rows, columns, S), written.
    """
    (places, period), (gamma, down, across) = grid, lens
    for row in range(pieces[0], pieces[1]):
        for column in range(samples.shape[1]):
            for site in range(len(places)):
                y, x = places[site, 0] + row * period, places[site, 1] + column * period
                whole, own, factor = np.float32(0), np.float32(0), _ONE
                for channel in range(len(gamma)):
                    light = np.float32(interpolated(luminance, down[channel, y], across[channel, x]))
                    whole += np.float32(gamma[channel]) * colour[row, column, channel] * light
                    if channel == places[site, 2]:
                        own = light
                if usable[row, column] and own > _NONE and whole > _NONE:
                    factor = min(max(whole / own, _ONE / MOST), MOST)
                out[row, column, site] = samples[row, column, site] * factor


@parallel_kernel(pieces=lambda luminance, chromaticity, first, down, *_: down.shape[1])
def with_fringes(
    pieces: Pieces,
    luminance: Floats2,
    chromaticity: Floats3,
    first: int,
    down: Doubles2,
    across: Doubles2,
    gamma: Floats1,
    out: Floats3,
) -> None:
    """Displace the channels of a picture; its luminance stays.

    luminance, chromaticity: (rows, W) and (rows, W, C), of the rows that are seen.
    first: the row of these that is the first one of the result.
    down, across: where each channel sees each row of the result, (C, its rows), and each column, (C, W): a row and a column of
        what is seen, and a fraction.
    gamma: (C,), the weights of Eq. 7.
    out: (rows of the result, W, C), chromaticity, written.
    """
    (height, width), count = luminance.shape, chromaticity.shape[2]
    mixed, weights = np.empty((count, width), np.float32), np.empty(4, np.float32)
    taps, left = np.empty((count, width, 4), np.float32), np.empty((count, width), np.intp)
    for channel in range(count):
        for x in range(width):
            left[channel, x] = _between(across[channel, x], taps[channel, x])
    for row in range(pieces[0], pieces[1]):
        for channel in range(count):
            top, line = _between(down[channel, row], weights), mixed[channel]
            line[:] = _NONE
            for tap in range(4):
                seen = min(max(top + tap, 0), height - 1)
                for x in range(width):
                    line[x] += weights[tap] * chromaticity[seen, x, channel] * luminance[seen, x]
        for x in range(width):
            light, total = luminance[first + row, x], _NONE
            for channel in range(count):
                before, moved = chromaticity[first + row, x, channel], _NONE
                for tap in range(4):
                    moved += taps[channel, x, tap] * mixed[channel, min(max(left[channel, x] + tap, 0), width - 1)]
                if light > _NONE and before > _NONE:
                    change = min(max(moved / (light * before), _ONE / MOST), MOST) - _ONE
                    before *= _ONE + change * change * change / (change * change + _FAINT * _FAINT)
                out[row, x, channel] = before
                total += gamma[channel] * before
            # Out of these bounds colours are no colours: in pixels below black, say.
            inside = light > _NONE and _ONE / MOST < total < MOST
            for channel in range(count):
                out[row, x, channel] = out[row, x, channel] / total if inside else chromaticity[first + row, x, channel]


@kernel
def _between(place: float, weights: Floats1) -> int:
    """The first of the four pixels between which a place lies, and their weights."""
    second = np.floor(place)
    weights[0], weights[1], weights[2], weights[3] = cubic_taps(np.float32(place - second))
    return int(second) - 1


@kernel
def _look(luminance: Floats2, y: int, x: int, lens: Lens, shares: Floats1, lights: Floats2) -> Scalar:
    """What each channel sees of luminance at a pixel, and its slopes there, in `lights`; returns the sum by their shares."""
    total, (gamma, down, across) = 0.0, lens
    for channel in range(len(gamma)):
        _interpolate(luminance, down[channel, y], across[channel, x], lights[channel])
        total += gamma[channel] * shares[channel] * lights[channel, 0]
    return total


@kernel
def _interpolate(plane: Floats2, y: Scalar, x: Scalar, found: Floats1) -> None:
    """Bicubic interpolation (Keys 1981, a = -1/2), and its slopes down and across; beyond the edges the nearest pixel counts."""
    top, left = int(np.floor(y)), int(np.floor(x))
    at_y, at_x = np.float32(y - top), np.float32(x - left)
    down, along, steeper, wider = cubic_taps(at_y), cubic_taps(at_x), _cubic_slopes(at_y), _cubic_slopes(at_x)
    found[:] = _NONE
    for i in range(4):
        row, value, slope = min(max(top + i - 1, 0), plane.shape[0] - 1), _NONE, _NONE
        for j in range(4):
            pixel = plane[row, min(max(left + j - 1, 0), plane.shape[1] - 1)]
            value += along[j] * pixel
            slope += wider[j] * pixel
        found[0] += down[i] * value
        found[1] += steeper[i] * value
        found[2] += down[i] * slope


@kernel
def _cubic_slopes(t: Scalar) -> Taps:
    """The derivatives of `cubic_taps`."""
    two, three, four = np.float32(2), np.float32(3), np.float32(4)
    eight, nine, ten = np.float32(8), np.float32(9), np.float32(10)
    square = t * t
    return (
        _HALF * (four * t - three * square - _ONE),
        _HALF * (nine * square - ten * t),
        _HALF * (_ONE + eight * t - nine * square),
        _HALF * (three * square - two * t),
    )
