"""Luminance where the panchromatic samples are clipped: interpolated between blocks, and corrected to meet unclipped samples."""

import numpy as np

from .arrays import Bools2, Doubles1, Floats2, Frozen2
from .compile import Pieces, parallel_kernel



@parallel_kernel()
def raise_clipped(
    pieces: Pieces,
    signal: Frozen2,
    panchromatic: Bools2,
    clipping: float,
    tolerance: float,
    plane: Floats2,
    fall: Doubles1,
    faint: float,
    result: Floats2,
) -> None:
    """Estimate what the clipped panchromatic samples would have read; never less than the clipped sample.

    The estimate is the blocks' prediction plus the mean difference of nearby unclipped samples from it, weighted by distance. The
    larger a sample's difference, the smaller its weight; from `tolerance` on it is 0: the sample belongs to another surface.

    signal: (H, W), scene units.
    panchromatic: bool (K, K), the pattern from the frame's corner on.
    clipping: scene units from which on a sample is clipped.
    tolerance: scene units, > 0; see above.
    plane: (H, W), luminance that the blocks predict.
    fall: weight at each distance; a sample has fall[rows away] * fall[columns away].
    faint: weight of a difference of 0, which is always added.
    result: (H, W), equal to `signal`; the clipped panchromatic samples are written.
    """
    height, width = signal.shape
    period, reach = len(panchromatic), len(fall) - 1
    for row in range(pieces[0], pieces[1]):
        for column in range(width):
            if not panchromatic[row % period, column % period] or signal[row, column] < clipping:
                continue
            total, weights = 0.0, faint
            for y in range(max(row - reach, 0), min(row + reach + 1, height)):
                for x in range(max(column - reach, 0), min(column + reach + 1, width)):
                    difference = signal[y, x] - plane[y, x]
                    if panchromatic[y % period, x % period] and signal[y, x] < clipping and abs(difference) < tolerance:
                        weight = fall[abs(y - row)] * fall[abs(x - column)] * (1.0 - abs(difference) / tolerance)
                        total += weight * difference
                        weights += weight
            result[row, column] = max(signal[row, column], np.float32(plane[row, column] + total / weights))
