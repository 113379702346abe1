"""Averaging what is known of each block over blocks around it that look alike: all offsets of a window, sixteen blocks in lanes."""

import numpy as np

from shared.arrays import FloatArray

from .compile import kernel, parallel_kernel, prange
from .functions import exponential, zeros
from .lanes import WIDTH, Scalar, load, quotient, store

SLACK = WIDTH
"""Columns behind the border, for lanes to run over."""
_LANES = WIDTH
_NONE = np.float32(0)


@parallel_kernel
def pool(sums: FloatArray, looks: FloatArray, radius: int, near: FloatArray, light: Scalar, out: FloatArray) -> None:
    """Write the weighted sums of `sums` over a window around each block to `out`, (S, rows, columns + SLACK).

    sums: (S, radius + rows + radius, radius + columns + radius + SLACK), 0 outside the frame. looks: (C + 2, as there): C
    chromaticities, their variance times 2 (any positive one outside the frame), log luminance. Two blocks weigh
    exp(-(squared distance of chromaticities) / (sum of both variances) + light * (difference of log luminance)**2) times
    near[|rows apart|, |columns apart|]; near: (radius + 1, radius + 1).
    """
    rows = out.shape[1]
    for row in prange(rows):
        total = zeros(len(sums) * _LANES).reshape(len(sums), _LANES)
        _pool_row(sums, looks, row, radius, near, np.float32(light), total, out)


@kernel
def _pool_row(
    sums: FloatArray, looks: FloatArray, row: int, radius: int, near: FloatArray, light: Scalar, total: FloatArray, out: FloatArray
) -> None:
    channels = len(looks) - 2
    for column in range(0, out.shape[2] - SLACK, _LANES):
        total[:] = _NONE
        variance = load(looks, (channels, row + radius, column + radius))
        brightness = load(looks, (channels + 1, row + radius, column + radius))
        for down in range(2 * radius + 1):
            for across in range(2 * radius + 1):
                y, x = row + down, column + across
                apart = variance * _NONE
                for channel in range(channels):
                    step = load(looks, (channel, y, x)) - load(looks, (channel, row + radius, column + radius))
                    apart += step * step
                brighter = load(looks, (channels + 1, y, x)) - brightness
                unlike = quotient(apart, variance + load(looks, (channels, y, x)))
                weight = exponential(light * (brighter * brighter) - unlike) * near[abs(down - radius), abs(across - radius)]
                for plane in range(len(sums)):
                    store(total, (plane, 0), load(total, (plane, 0)) + weight * load(sums, (plane, y, x)))
        for plane in range(len(sums)):
            store(out, (plane, row, column), load(total, (plane, 0)))
