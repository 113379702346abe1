"""Weighted averages of the statistics of blocks over similar blocks nearby: all offsets of a window, sixteen blocks in lanes."""

import numpy as np

from .arrays import Floats1, Floats2, Floats3, Scalar, Single
from .compile import Pieces, kernel, parallel_kernel
from .functions import exponential, zeros
from .lanes import WIDTH, Lanes, load, quotient, store

SLACK = WIDTH
"""Columns after the border, so that the last vector stays inside the array."""
_TOGETHER = 2  # statistics that are summed together: the sums of more, for a pair of rows, do not fit in the registers of AVX2
CHANNELS = 3
"""Chromaticities that are compared together; their number is a multiple of this."""
_PAIR = 2  # rows that are computed together: what is read for one serves the other
_ZERO = np.float32(0)


@parallel_kernel(pieces=lambda *given: -(-given[-1].shape[1] // _PAIR))
def pool(pieces: Pieces, sums: Floats3, features: Floats3, radius: int, near: Floats2, light: Single, out: Floats3) -> None:
    """Sum the statistics of the blocks in a window around each block, weighted by similarity.

    The weight of two blocks is near[rows between them, columns between them] times exp(-(squared distance of chromaticities) /
    (sum of both variance planes) + light * (difference of log luminance)**2).

    sums: (S, radius + rows + radius + 1, radius + columns + radius + SLACK), the statistics; 0 outside the frame. S is even.
    features: (C + 2, as `sums`): C chromaticities, their scaled variance (any positive one outside the frame), log luminance. C is
        a multiple of `CHANNELS`.
    radius: radius of the window, blocks.
    near: (radius + 2, radius + 1), weights by distance, to any scale; the last row is 0.
    light: < 0, see above.
    out: (S, rows, columns + SLACK), written.
    """
    rows = out.shape[1]
    for pair in range(pieces[0], pieces[1]):
        total, weights = zeros(_PAIR * len(sums), WIDTH), zeros(_PAIR, 2 * radius + 1, WIDTH)
        centre = zeros(_PAIR, len(features), WIDTH)
        for column in range(0, out.shape[2] - SLACK, WIDTH):
            total[:] = _ZERO
            for row in range(_PAIR):
                for plane in range(len(features)):
                    store(centre, (row, plane, 0), load(features, (plane, _PAIR * pair + row + radius, column + radius)))
            for down in range(2 * radius + _PAIR):
                y = _PAIR * pair + down
                _weigh(
                    features, centre, y, column, near[abs(down - radius)], near[abs(down - radius - 1)], np.float32(light), weights
                )
                _sum(sums, weights, y, column, total)
            for row in range(_PAIR * pair, min(_PAIR * pair + _PAIR, rows)):
                for plane in range(len(sums)):
                    store(out, (plane, row, column), load(total, (_PAIR * plane + row % _PAIR, 0)))


@kernel
def _weigh(
    features: Floats3, centre: Floats3, y: int, column: int, near: Floats1, near_lower: Floats1, light: Scalar, weights: Floats3
) -> None:
    """The weights of all blocks in row `y` for a pair of rows of blocks: their features are `centre`, their distances `near`."""
    channels, radius = len(features) - 2, weights.shape[1] // 2
    for across in range(weights.shape[1]):
        x, away = column + across, abs(across - radius)
        upper = load(features, (channels, y, x)) * _ZERO
        lower = upper
        for channel in range(0, channels, CHANNELS):
            a, b, c = load(features, (channel, y, x)), load(features, (channel + 1, y, x)), load(features, (channel + 2, y, x))
            upper = _farther(upper, a, b, c, centre, 0, channel)
            lower = _farther(lower, a, b, c, centre, 1, channel)
        variance, brightness = load(features, (channels, y, x)), load(features, (channels + 1, y, x))
        upper = _weight(upper, variance, brightness, centre, 0, channels, light) * near[away]
        lower = _weight(lower, variance, brightness, centre, 1, channels, light) * near_lower[away]
        store(weights, (0, across, 0), upper)
        store(weights, (1, across, 0), lower)


@kernel
def _farther(distance: Lanes, a: Lanes, b: Lanes, c: Lanes, centre: Floats3, row: int, channel: int) -> Lanes:
    """A squared distance, to which that of three features from those of a row of the pair is added."""
    a -= load(centre, (row, channel, 0))
    b -= load(centre, (row, channel + 1, 0))
    c -= load(centre, (row, channel + 2, 0))
    return distance + a * a + b * b + c * c


@kernel
def _weight(distance: Lanes, variance: Lanes, brightness: Lanes, centre: Floats3, row: int, channels: int, light: Scalar) -> Lanes:
    """How similar blocks are, from the squared distance of their chromaticities, their variance and their brightness."""
    brighter = brightness - load(centre, (row, channels + 1, 0))
    dissimilar = quotient(distance, load(centre, (row, channels, 0)) + variance)
    return exponential(light * (brighter * brighter) - dissimilar)


@kernel
def _sum(sums: Floats3, weights: Floats3, y: int, column: int, total: Floats2) -> None:
    """Add the weighted statistics of a row of the window to the totals of a pair of rows."""
    for plane in range(0, len(sums), _TOGETHER):
        t = _PAIR * plane
        a, b, c, d = load(total, (t, 0)), load(total, (t + 1, 0)), load(total, (t + 2, 0)), load(total, (t + 3, 0))
        for across in range(weights.shape[1]):
            first, second = load(sums, (plane, y, column + across)), load(sums, (plane + 1, y, column + across))
            upper, lower = load(weights, (0, across, 0)), load(weights, (1, across, 0))
            a, b, c, d = a + upper * first, b + lower * first, c + upper * second, d + lower * second
        for place, value in enumerate((a, b, c, d)):
            store(total, (t + place, 0), value)
