"""Bicubic interpolation between the pixels of a plane."""

import numpy as np

from .arrays import Floats2, Scalar
from .compile import Chunks, kernel, parallel_kernel


@kernel
def interpolated(plane: Floats2, y: Scalar, x: Scalar) -> Scalar:
    """Bicubic interpolation (Keys 1981, a = -1/2); beyond the edges the nearest pixel counts."""
    top, left = int(np.floor(y)), int(np.floor(x))
    down, along = cubic_taps(np.float32(y - top)), cubic_taps(np.float32(x - left))
    total = np.float32(0)
    if 1 <= top < plane.shape[0] - 2 and 1 <= left < plane.shape[1] - 2:
        for i in range(4):
            total += down[i] * (
                along[0] * plane[top + i - 1, left - 1] + along[1] * plane[top + i - 1, left]
                + along[2] * plane[top + i - 1, left + 1] + along[3] * plane[top + i - 1, left + 2]
            )  # fmt: skip
        return total
    for i in range(4):
        row = min(max(top + i - 1, 0), plane.shape[0] - 1)
        for j in range(4):
            total += down[i] * along[j] * plane[row, min(max(left + j - 1, 0), plane.shape[1] - 1)]
    return total


@kernel
def cubic_taps(t: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Weights of four neighbours (Keys 1981, a = -1/2) for a place 0 <= t < 1 after the second, in
    the precision of `t`.
    """
    half = np.float32(0.5)
    square, cube = t * t, t * t * t
    first, last = half * (square + square - cube - t), half * (cube - square)
    second = half * (np.float32(3) * cube - np.float32(5) * square + np.float32(2))
    third = half * (np.float32(4) * square - np.float32(3) * cube + t)
    return first, second, third, last


@parallel_kernel()
def interpolate(
    chunks: Chunks, values: Floats2, first: tuple[float, float], period: int, plane: Floats2
) -> None:
    """Interpolate a grid of samples, one every `period` pixels, to every pixel of `plane`.

    Parameters
    ----------
    values : Floats2
        (rows, columns), the samples; the first lies at the pixel `first`.
    plane : Floats2
        (H, W), written. Bicubic (Keys 1981, a = -1/2); constant beyond the outermost samples.
    """
    rows, columns = values.shape
    for row in range(chunks[0], chunks[1]):
        place = (row - first[0]) / period
        down = int(np.floor(place))
        weights_down = cubic_taps(place - down)
        across_line = np.zeros(columns, np.float32)
        for tap in range(4):
            line = values[min(max(down + tap - 1, 0), rows - 1)]
            for j in range(columns):
                across_line[j] += np.float32(weights_down[tap]) * line[j]
        for column in range(plane.shape[1]):
            at = (column - first[1]) / period
            across = int(np.floor(at))
            weights = cubic_taps(at - across)
            total = np.float32(0)
            for tap in range(4):
                beside = min(max(across + tap - 1, 0), columns - 1)
                total += np.float32(weights[tap]) * across_line[beside]
            plane[row, column] = total
