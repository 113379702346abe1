"""Correct the colour of every pixel of a burst by the colour samples of all frames.

A picture differs from each sample by some error. The correction of the picture's colour leaves little of these errors and changes
little from pixel to pixel, except across edges of luminance: it minimises a sum of squares, by conjugate gradients.
Without samples near a pixel its correction fades to nothing. Corrections leave luminance as it is.

Colours are weighted by gamma here: then channels have the unit of luminance, and a colour is a set of C numbers that add up to
zero: C - 1 coefficients on an orthonormal basis.
"""

import numpy as np

from ..numerics.arrays import Area, Bytes1, Doubles1, Floats1, Floats2, Floats3, Ints1, Pair, Scalar
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import tile_at, zeros
from ..numerics.linked import TILE, Prior, link, solve
from ..parts import DARK

HALO = 24
"""Pixels around a tile that are solved with it. Chosen."""
TOLERANCE = 1e-3
"""Relative residual at which conjugate gradients stop. Chosen: that of `AffinitySettings`."""
_ZERO, _ONE = np.float32(0), np.float32(1)
_DARK = np.float32(DARK)

Samples = tuple[Floats2, Bytes1, Ints1]
"""(figures, channels, starts) of M samples, sorted by tile: (M, 5), row and column in the frame, value times gamma, luminance,
precision; (M,), their channels; (tiles + 1,), where those of each tile begin, tiles counted row by row."""


@parallel_kernel()
def spread_samples(
    pieces: Pieces,
    luminance: Floats2,
    chromaticity: Floats3,
    first: int,
    rows: Pair,
    height: int,
    samples: Samples,
    gamma: Floats1,
    basis: Floats2,
    prior: Prior,
    out: Floats3,
    residuals: Doubles1,
    used: Ints1,
) -> None:
    """Correct the chromaticity of some rows of the frame.

    luminance, chromaticity: (rows, W) and (rows, W, C), a part of the picture that reaches `HALO` beyond the rows to correct.
    first: the frame's row at luminance[0].
    rows: first and end row to correct; the first is a multiple of `TILE`, and so is the end, or it is the frame's.
    height: rows of the frame.
    gamma: (C,), the weights of Eq. 7. basis: (C, C - 1), orthonormal columns that add up to zero.
    prior: smoothness and fading relative to the precision of a sample, and the difference of luminance, scene units, that is an
        edge.
    out: (rows, W, C), written.
    residuals, used: (tiles,), written: relative residual and iterations of each tile, see `tiles_of`.
    """
    width, channels = luminance.shape[1], len(gamma)
    for number in range(pieces[0], pieces[1]):
        top, bottom, left, right = tile_at(number, (rows[1] - rows[0], width), (TILE, TILE))
        top, bottom = rows[0] + top, rows[0] + bottom
        area = max(top - HALO, 0), min(bottom + HALO, height), max(left - HALO, 0), min(right + HALO, width)
        size = area[1] - area[0], area[3] - area[2]
        light = luminance[area[0] - first : area[1] - first, area[2] : area[3]]
        colour = chromaticity[area[0] - first : area[1] - first, area[2] : area[3]]
        unknowns = zeros(channels - 1, *size)
        normal, right_side = zeros((channels - 1) * channels // 2, *size), zeros(channels - 1, *size)
        _gather(light, colour, area, (top // TILE, left // TILE), (height, width), samples, gamma, basis, normal, right_side)
        links = zeros(4, *size)
        link(light, prior, links)
        residuals[number], used[number] = solve(normal, right_side, links, np.float32(prior[1]), TOLERANCE, unknowns)
        for row in range(top, bottom):
            for column in range(left, right):
                y, x = row - area[0], column - area[2]
                lit = light[y, x] > _DARK
                for channel in range(channels):
                    step = _ZERO
                    for part in range(channels - 1):
                        step += basis[channel, part] * unknowns[part, y, x]
                    change = step / (gamma[channel] * light[y, x]) if lit else _ZERO
                    out[row - rows[0], column, channel] = colour[y, x, channel] + change


@kernel
def _gather(
    light: Floats2, colour: Floats3, area: Area, tile: Pair, shape: Pair,
    samples: Samples, gamma: Floats1, basis: Floats2, normal: Floats3, right_side: Floats3
) -> None:  # fmt: skip
    """Compute the normal equations of the samples in an area, each shared out to the four pixels around it."""
    figures, channels, starts = samples
    down, along = (shape[0] + TILE - 1) // TILE, (shape[1] + TILE - 1) // TILE
    parts = basis.shape[1]
    for row in range(max(tile[0] - 1, 0), min(tile[0] + 2, down)):
        for column in range(max(tile[1] - 1, 0), min(tile[1] + 2, along)):
            for sample in range(starts[row * along + column], starts[row * along + column + 1]):
                y, x = figures[sample, 0] - np.float32(area[0]), figures[sample, 1] - np.float32(area[2])
                if not (_ZERO <= y <= light.shape[0] - 1 and _ZERO <= x <= light.shape[1] - 1):
                    continue
                above, before = min(int(y), light.shape[0] - 2), min(int(x), light.shape[1] - 2)
                lower, after = y - np.float32(above), x - np.float32(before)
                channel, weight = channels[sample], figures[sample, 4]
                seen = _ZERO
                for corner in range(4):
                    share = _share(corner, lower, after)
                    seen += share * colour[above + corner // 2, before + corner % 2, channel]
                error = figures[sample, 2] - gamma[channel] * seen * figures[sample, 3]
                for corner in range(4):
                    share = _share(corner, lower, after) * weight
                    i, j, place = above + corner // 2, before + corner % 2, 0
                    for part in range(parts):
                        right_side[part, i, j] += share * basis[channel, part] * error
                        for other in range(part, parts):
                            normal[place, i, j] += share * basis[channel, part] * basis[channel, other]
                            place += 1


@kernel
def _share(corner: int, down: Scalar, along: Scalar) -> Scalar:
    """The share of one of the four pixels around a place in bilinear interpolation."""
    return (down if corner // 2 else _ONE - down) * (along if corner % 2 else _ONE - along)
