"""Sampled Gaussians, cut off at four standard deviations, and smoothing of planes with them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import FloatArray
from .arrays import Floats1, Floats2, Frozen2, Scalar
from .compile import Chunks, kernel, parallel_kernel
from .functions import mirror_ends, mirrored

TRUNCATE = 4
"""Standard deviations at which a Gaussian ends: what lies beyond is 6e-5 of it."""


def gaussian(sigma: float) -> FloatArray:
    """Taps of a Gaussian, which sum to one: float32, an odd number of them.

    Parameters
    ----------
    sigma : float
        > 0, standard deviation in samples.
    """
    radius = int(TRUNCATE * sigma + 0.5)
    taps = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    return (taps / taps.sum()).astype(np.float32)


def smoothed(planes: NDArray[Any], sigma: float) -> FloatArray:
    """`planes` (..., rows, columns) convolved with a Gaussian along rows and columns, mirrored at
    the border; float32.

    Parameters
    ----------
    sigma : float
        Standard deviation in samples; 0 changes nothing.
    """
    return filtered(planes, gaussian(sigma)) if sigma else np.ascontiguousarray(planes, np.float32)


def filtered(planes: NDArray[Any], taps: FloatArray) -> FloatArray:
    """Planes convolved like `smoothed`, with an odd number of taps of any symmetric filter."""
    source = np.ascontiguousarray(planes, np.float32)
    result, shape = np.empty_like(source), (-1, *source.shape[-2:])
    for plane, out in zip(source.reshape(shape), result.reshape(shape), strict=True):
        smooth(plane, taps, out)
    return result


_STRIP = 64  # rows of a chunk; chosen for speed


@parallel_kernel(chunks=lambda plane, *_: -(-len(plane) // _STRIP))
def smooth(chunks: Chunks, plane: Frozen2, taps: Floats1, out: Floats2) -> None:
    """Smooth a plane along rows and columns; it is mirrored at its border.

    Parameters
    ----------
    plane : Frozen2
        (H, W).
    taps : Floats1
        Of a symmetric filter, an odd number.
    out : Floats2
        (H, W), written; not `plane` itself.
    """
    for strip in range(chunks[0], chunks[1]):
        smooth_rows(plane, taps, strip * _STRIP, min((strip + 1) * _STRIP, len(plane)), out)


@kernel
def smooth_rows(plane: Floats2, taps: Floats1, first: int, last: int, out: Floats2) -> None:
    """Smooth rows `first` to `last` alone, otherwise like `smooth`."""
    (height, width), reach = plane.shape, len(taps) // 2
    line = np.empty(width + 2 * reach, np.float32)
    for row in range(first, last):
        _scale(taps[reach], plane[row], line[reach : reach + width])
        for step in range(1, reach + 1):
            above, below = plane[mirrored(row - step, height)], plane[mirrored(row + step, height)]
            _add(taps[reach + step], above, below, line[reach : reach + width])
        mirror_ends(line, reach)
        _scale(taps[reach], line[reach:], out[row])
        for step in range(1, reach + 1):
            _add(taps[reach + step], line[reach - step :], line[reach + step :], out[row])


@kernel
def _scale(tap: Scalar, line: Floats1, out: Floats1) -> None:
    for column in range(len(out)):
        out[column] = tap * line[column]


@kernel
def _add(tap: Scalar, line: Floats1, other: Floats1, out: Floats1) -> None:
    for column in range(len(out)):
        out[column] += tap * (line[column] + other[column])
