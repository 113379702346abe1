"""Weighted averages of the statistics of blocks over similar blocks nearby: all offsets of a window, sixteen blocks in lanes."""

import numpy as np

from shared.arrays import FloatArray

from .compile import kernel, parallel_kernel, prange
from .functions import exponential, zeros
from .lanes import WIDTH, Scalar, load, quotient, store

SLACK = WIDTH
"""Columns after the border, so that the last vector stays inside the array."""
_NONE = np.float32(0)


@parallel_kernel("f4[:, :, ::1], f4[:, :, ::1], i8, f4[:, ::1], f4, f4[:, :, ::1]")
def pool(sums: FloatArray, features: FloatArray, radius: int, near: FloatArray, light: Scalar, out: FloatArray) -> None:
    """Sum the statistics of the blocks in a window around each block, weighted by similarity.

    The weight of two blocks is near[rows between them, columns between them] times exp(-(squared distance of chromaticities) /
    (sum of both variance planes) + light * (difference of log luminance)**2).

    sums: (S, radius + rows + radius, radius + columns + radius + SLACK), the statistics; 0 outside the frame.
    features: (C + 2, as `sums`): C chromaticities, their scaled variance (any positive one outside the frame), log luminance.
    radius: radius of the window, blocks.
    near: (radius + 1, radius + 1), weights by distance.
    light: < 0, see above.
    out: (S, rows, columns + SLACK), written.
    """
    rows = out.shape[1]
    for row in prange(rows):
        total = zeros(len(sums), WIDTH)
        _pool_row(sums, features, row, radius, near, np.float32(light), total, out)


@kernel
def _pool_row(
    sums: FloatArray,
    features: FloatArray,
    row: int,
    radius: int,
    near: FloatArray,
    light: Scalar,
    total: FloatArray,
    out: FloatArray,
) -> None:
    channels = len(features) - 2
    for column in range(0, out.shape[2] - SLACK, WIDTH):
        total[:] = _NONE
        variance = load(features, (channels, row + radius, column + radius))
        brightness = load(features, (channels + 1, row + radius, column + radius))
        for down in range(2 * radius + 1):
            for across in range(2 * radius + 1):
                y, x = row + down, column + across
                distance = variance * _NONE
                for channel in range(channels):
                    step = load(features, (channel, y, x)) - load(features, (channel, row + radius, column + radius))
                    distance += step * step
                brighter = load(features, (channels + 1, y, x)) - brightness
                dissimilar = quotient(distance, variance + load(features, (channels, y, x)))
                weight = exponential(light * (brighter * brighter) - dissimilar) * near[abs(down - radius), abs(across - radius)]
                for plane in range(len(sums)):
                    store(total, (plane, 0), load(total, (plane, 0)) + weight * load(sums, (plane, y, x)))
        for plane in range(len(sums)):
            store(out, (plane, row, column), load(total, (plane, 0)))
