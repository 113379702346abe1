"""Sampled Gaussians, cut off at four standard deviations, and smoothing with them.

Smoothing of whole planes by a separable filter.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray

from .arrays import Floats1, Floats2, Frozen2, Ints1
from .compile import Pieces, kernel, parallel_kernel
from .functions import mirrored, zeros
from .lanes import WIDTH, load, store

TRUNCATE = 4
"""Standard deviations at which a Gaussian ends: what lies beyond is 6e-5 of it."""


def gaussian(sigma: float) -> FloatArray:
    """Taps of a Gaussian, which sum to one: float32, an odd number of them. sigma: > 0, standard deviation in samples."""
    radius = int(TRUNCATE * sigma + 0.5)
    taps = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    return (taps / taps.sum()).astype(np.float32)


def smoothed(planes: NDArray[Any], sigma: float) -> FloatArray:
    """`planes` (..., rows, columns) convolved with a Gaussian along rows and columns, mirrored at the border; float32.

    sigma: standard deviation in samples; 0 changes nothing.
    """
    return filtered(planes, gaussian(sigma)) if sigma else np.ascontiguousarray(planes, np.float32)


def filtered(planes: NDArray[Any], taps: FloatArray) -> FloatArray:
    """As `smoothed`, by the taps of another symmetric filter, an odd number."""
    source = np.ascontiguousarray(planes, np.float32)
    found, shape = np.empty_like(source), (-1, *source.shape[-2:])
    for plane, out in zip(source.reshape(shape), found.reshape(shape), strict=True):
        smooth(plane, taps, out)
    return found


_STRIP = 64  # rows that one piece of work smooths; chosen for speed
_ZERO = np.float32(0)


@parallel_kernel(pieces=lambda plane, *_: -(-len(plane) // _STRIP))
def smooth(pieces: Pieces, plane: Frozen2, taps: Floats1, out: Floats2) -> None:
    """Smooth a plane along rows and columns; it is mirrored at its border.

    plane: (H, W). taps: of a symmetric filter, an odd number. out: (H, W), written; not `plane` itself.
    """
    height = len(plane)
    for strip in range(pieces[0], pieces[1]):
        smooth_rows(plane, taps, strip * _STRIP, min((strip + 1) * _STRIP, height), out)


@kernel
def smooth_rows(plane: Floats2, taps: Floats1, first: int, last: int, out: Floats2) -> None:
    """As `smooth`, rows `first` to `last` alone."""
    (height, width), reach = plane.shape, len(taps) // 2
    lines, total = zeros(len(taps), width + 2 * WIDTH), zeros(width + 2 * reach + 3 * WIDTH)
    slots = np.empty(len(taps), np.intp)
    for row in range(first - reach, last + reach):
        source = mirrored(row, height)
        for column in range(width):
            lines[row % len(taps), column] = plane[source, column]
        if row >= first + reach:
            for step in range(len(taps)):
                slots[step] = (row - 2 * reach + step) % len(taps)
            _sum_down(lines, slots, taps, width, reach, total)
            oldest = slots[0]  # its line is not needed any more
            for column in range(0, width, WIDTH):
                light = taps[0] * load(total, column)
                for step in range(1, len(taps)):
                    light += taps[step] * load(total, column + step)
                store(lines, (oldest, column), light)
            for column in range(width):
                out[row - reach, column] = lines[oldest, column]


@kernel
def _sum_down(lines: Floats2, slots: Ints1, taps: Floats1, width: int, reach: int, total: Floats1) -> None:
    """Sum up the rows in `slots`, weighted, to `total`, which gets mirrored columns on both sides."""
    for column in range(0, width, WIDTH):
        light = taps[0] * load(lines, (slots[0], column))
        for step in range(1, len(taps)):
            light += taps[step] * load(lines, (slots[step], column))
        store(total, column + reach, light)
    for step in range(1, reach + 1):
        total[reach - step] = total[reach + mirrored(-step, width)]
        total[reach + width - 1 + step] = total[reach + mirrored(width - 1 + step, width)]
