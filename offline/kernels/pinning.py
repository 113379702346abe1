"""Chromaticity from colour sites that are scattered: each channel is pinned at its own sites and spreads from there.

The field of a channel is the one that stays close to what its sites measured and changes little from pixel to pixel, except across
edges of luminance: a sum of squares, whose minimum conjugate gradients find. It departs from a base, a first guess, to which it
fades where no site is trusted.
"""

import numpy as np

from .arrays import Bytes2, Doubles1, Floats2, Floats3, Ints1, Pair
from .compile import Pieces, parallel_kernel
from .functions import tile_at, zeros
from .linked import TILE, Prior, link, solve

HALO = 16
"""Pixels around a tile that are solved with it: colour sites are near everywhere, so fields beyond have no influence. Chosen."""
TOLERANCE = 1e-4
"""Relative residual at which conjugate gradients stop. Chosen."""
_ZERO = np.float32(0)


@parallel_kernel()
def pin_samples(
    pieces: Pieces,
    luminance: Floats2,
    base: Floats3,
    channels: Bytes2,
    ratios: Floats2,
    weights: Floats2,
    first: int,
    rows: Pair,
    prior: Prior,
    out: Floats3,
    residuals: Doubles1,
    used: Ints1,
) -> None:
    """Find the chromaticity of some rows of the frame.

    luminance, base: (rows, W) and (rows, W, C), a part of the picture that reaches `HALO` beyond the rows to find.
    channels: (rows, W), the channel of each colour site; C elsewhere.
    ratios: (rows, W), chromaticity of that channel as its site measured it.
    weights: (rows, W), how far the site is trusted, 0 to 1.
    first: the frame's row at luminance[0].
    rows: first and end row to find; the first is a multiple of `TILE`.
    prior: smoothness and fading relative to a site of weight 1, and the difference of luminance, scene units, that is an edge.
    out: (rows, W, C), written.
    residuals, used: (tiles,), written: see `spreading.spread_samples`; the worst of all channels.
    """
    (height, width), count = luminance.shape, base.shape[2]
    for number in range(pieces[0], pieces[1]):
        top, bottom, left, right = tile_at(number, (rows[1] - rows[0], width), (TILE, TILE))
        top, bottom = rows[0] - first + top, rows[0] - first + bottom
        above, below, before, after = max(top - HALO, 0), min(bottom + HALO, height), max(left - HALO, 0), min(right + HALO, width)
        size = below - above, after - before
        links, normal, right_side, field = zeros(4, *size), zeros(1, *size), zeros(1, *size), zeros(1, *size)
        link(luminance[above:below, before:after], prior, links)
        residuals[number], used[number] = 0.0, 0
        for channel in range(count):
            for row in range(size[0]):
                for column in range(size[1]):
                    y, x = above + row, before + column
                    weight = weights[y, x] if channels[y, x] == channel else _ZERO
                    normal[0, row, column] = weight
                    right_side[0, row, column] = weight * (ratios[y, x] - base[y, x, channel])
                    field[0, row, column] = _ZERO
            residual, iterations = solve(normal, right_side, links, np.float32(prior[1]), TOLERANCE, field)
            used[number] = max(iterations, used[number])
            if residual > residuals[number] or np.isnan(residual):
                residuals[number] = residual
            for y in range(top, bottom):
                for x in range(left, right):
                    out[y - rows[0] + first, x, channel] = base[y, x, channel] + field[0, y - above, x - before]
