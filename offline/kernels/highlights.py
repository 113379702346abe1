"""Luminance where the panchromatic samples are at their limit: interpolated between blocks, and made to meet what is measured."""

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray

from .compile import kernel, parallel_kernel, prange

_TAPS = 4


@parallel_kernel
def interpolate(values: FloatArray, first: tuple[float, float], period: int, plane: FloatArray) -> None:
    """Write to `plane` (H, W) what values (rows, columns), `period` pixels apart from the place `first` on, are between them.

    By cubic convolution (Keys 1981, a = -1/2); beyond the outermost values those.
    """
    height, width = plane.shape
    rows, columns = values.shape
    for row in prange(height):
        down, weights_down = _taps((row - first[0]) / period)
        across_line = np.zeros(columns, np.float32)
        for tap in range(_TAPS):
            line = values[min(max(down + tap, 0), rows - 1)]
            for j in range(columns):
                across_line[j] += np.float32(weights_down[tap]) * line[j]
        for column in range(width):
            across, weights = _taps((column - first[1]) / period)
            total = np.float32(0)
            for tap in range(_TAPS):
                total += np.float32(weights[tap]) * across_line[min(max(across + tap, 0), columns - 1)]
            plane[row, column] = total


@kernel
def _taps(place: float) -> tuple[int, tuple[float, float, float, float]]:
    """The first of four neighbours, and their weights."""
    before = int(np.floor(place))
    t = place - before
    return before - 1, (
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )


@parallel_kernel
def raise_clipped(
    signal: FloatArray,
    panchromatic: BoolArray,
    clipping: float,
    apart: float,
    plane: FloatArray,
    fall: DoubleArray,
    faint: float,
    result: FloatArray,
) -> None:
    """Write to `result` what the clipped panchromatic samples would have read.

    signal, plane, result: (H, W); result equals signal elsewhere. plane: luminance as the blocks tell it. What unclipped samples
    differ from it, weighted by fall[rows away] fall[columns away], is added; `faint` is the weight of no difference. The more they
    differ the less they say, and from `apart` (scene units) on nothing: they belong to something else. Never less than the clipped
    sample itself.
    """
    height, width = signal.shape
    period, reach = len(panchromatic), len(fall) - 1
    for row in prange(height):
        for column in range(width):
            if not panchromatic[row % period, column % period] or signal[row, column] < clipping:
                continue
            total, weights = 0.0, faint
            for y in range(max(row - reach, 0), min(row + reach + 1, height)):
                for x in range(max(column - reach, 0), min(column + reach + 1, width)):
                    difference = signal[y, x] - plane[y, x]
                    if panchromatic[y % period, x % period] and signal[y, x] < clipping and abs(difference) < apart:
                        weight = fall[abs(y - row)] * fall[abs(x - column)] * (1.0 - abs(difference) / apart)
                        total += weight * difference
                        weights += weight
            result[row, column] = max(signal[row, column], np.float32(plane[row, column] + total / weights))
