"""Luminance of clipped samples: cubic convolution between blocks, plus the mean difference of nearby unclipped samples from it."""

import itertools
import math

from shared import CfaPattern
from shared.arrays import DoubleArray, FloatArray
from tests.reference.geometry import letter


def raised(
    signal: FloatArray,
    pattern: CfaPattern,
    clipping: float,
    apart: float,
    plane: FloatArray,
    fall: DoubleArray,
    faint: float,
    place: tuple[int, int],
) -> float:
    """The restored sample at `place`: unchanged unless it is panchromatic and clipped.

    apart: largest difference from `plane` of samples that count, scene units; `raise_clipped` calls it tolerance.
    plane, fall, faint: as in `raise_clipped`.
    """
    if letter(pattern, *place) != "W" or signal[place] < clipping:
        return float(signal[place])
    differences, weights = [0.0], [faint]
    reach = range(-len(fall) + 1, len(fall))
    for y, x in itertools.product(reach, repeat=2):
        other = place[0] + y, place[1] + x
        if not (0 <= other[0] < signal.shape[0] and 0 <= other[1] < signal.shape[1]) or letter(pattern, *other) != "W":
            continue
        difference = float(signal[other]) - float(plane[other])
        if signal[other] < clipping and abs(difference) < apart:
            differences.append(difference)
            weights.append(float(fall[abs(y)] * fall[abs(x)]) * (1 - abs(difference) / apart))
    mean = math.fsum(d * w for d, w in zip(differences, weights, strict=True)) / math.fsum(weights)
    return max(float(signal[place]), float(plane[place]) + mean)
