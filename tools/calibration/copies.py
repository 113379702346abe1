"""Frames that are copies of one another: their difference shows no noise, so they measure none."""

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np

from shared import Mosaic
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

# Largest correlation of the noise of two frames. Fixed pattern correlates too: in dark frames it is smaller than the read noise, at
# least without rows and columns; in bright flat frames of large pixels it reaches 0.88 (1 % at 100,000 electrons).
DARK_ALIKE, FLAT_ALIKE = 0.67, 0.9
_SAMPLES = 1 << 20  # of a frame: they decide as well as all of them
_LEAST = 50  # samples of a plane: with fewer, independent noise may correlate by chance
_OUTLIER = 6.0  # standard deviations: hot pixels are alike in all frames


def refuse_copies(frames: Sequence[tuple[str, Mosaic]], alike: float) -> None:
    """Raise InputError if two frames have the same noise: copies, perhaps edited, scaled or coded anew.

    frames: path and frame, of one camera, of equal size.
    alike: correlation above which the noise of two frames cannot be independent.
    """
    for (_, first), (path, other) in pairwise(frames):
        if first.shape != other.shape:
            raise InputError(f"{path}: has {other.shape[1]} x {other.shape[0]} pixels, the frame before it has other sizes")
    noise = [_noise(mosaic) for _, mosaic in frames]
    for one, other in combinations(range(len(frames)), 2):
        same = np.array_equal(frames[one][1].codes, frames[other][1].codes)
        likeness = 1.0 if same else max((_correlation(a, b) for a, b in zip(noise[one], noise[other], strict=True)), default=0.0)
        if likeness > alike:
            raise InputError(
                f"{frames[other][0]} and {frames[one][0]} have the same noise (correlation {likeness:.2f}): one is a copy of the "
                "other, and their difference measures nothing; take each frame anew (panchroma simulate: with another --seed)"
            )


def _noise(mosaic: Mosaic) -> list[DoubleArray]:
    """Return what neighbours of the same filter differ by, one array per plane with enough samples; if none has, of all together.

    The pattern repeats after a period, and the light hardly changes over it. What a row or a column has in common is taken away.
    """
    period, (rows, columns) = mosaic.pattern.period, mosaic.shape
    strips = np.unique(np.linspace(0, max(rows // period - 1, 0), max(_SAMPLES // (columns * period), 1)).astype(int))
    chosen = (strips[:, None] * period + np.arange(period)).ravel()
    chosen = chosen[chosen < rows]
    codes = mosaic.codes[chosen].astype(np.float64)
    difference = codes[:, period:] - codes[:, :-period]
    if not difference.size:
        return []
    planes = mosaic.pattern.filter_map(mosaic.shape)[chosen][:, period:]
    difference -= difference.mean(axis=0)
    difference -= difference.mean(axis=1, keepdims=True)
    masks: list[BoolArray] = [planes == plane for plane in range(len(mosaic.pattern.planes))]
    enough = [mask for mask in masks if mask.sum() >= _LEAST]
    return [_limited(difference[mask]) for mask in enough] or [_limited(difference.ravel())]


def _limited(values: DoubleArray) -> DoubleArray:
    low, high = np.quantile(values, (0.16, 0.84))
    spread = max((high - low) / 2, 1.0)
    limited: DoubleArray = np.clip(values - values.mean(), -_OUTLIER * spread, _OUTLIER * spread)
    return limited


def _correlation(one: DoubleArray, other: DoubleArray) -> float:
    size = np.sqrt((one**2).sum() * (other**2).sum())
    return float((one * other).sum() / size) if size > 0 else 0.0
