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
_OUTLIER = 5.0  # standard deviations


def refuse_copies(frames: Sequence[tuple[str, Mosaic]], alike: float) -> None:
    """Raise InputError if two frames have the same noise: copies, perhaps edited, scaled or re-encoded.

    frames: path and frame, of one camera, of equal size.
    alike: correlation above which the noise of two frames cannot be independent.
    """
    for (before, first), (path, second) in pairwise(frames):
        if first.shape != second.shape:
            (high, wide), (rows, columns) = second.shape, first.shape
            raise InputError(f"{path} has {wide} x {high} pixels, {before} {columns} x {rows}: they are from different cameras")
    noise = [_noise(mosaic) for _, mosaic in frames]
    for one, other in combinations(range(len(frames)), 2):
        same = np.array_equal(frames[one][1].codes, frames[other][1].codes)
        likeness = 1.0 if same else _correlation(noise[one], noise[other])
        if likeness > alike:
            raise InputError(
                f"{frames[other][0]} and {frames[one][0]} have the same noise (correlation {likeness:.2f}): one is a copy of the "
                "other, and their difference measures nothing, or they show a scene or a texture; take each frame anew (a "
                "simulated one with another seed), of an even surface"
            )


def _noise(mosaic: Mosaic) -> DoubleArray:
    """Return what neighbours of the same filter differ by, NaN for outliers.

    The pattern repeats after a period, and the light hardly changes over it. What a row or a column has in common is taken away.
    """
    period, (rows, columns) = mosaic.pattern.period, mosaic.shape
    strips = np.unique(np.linspace(0, max(rows // period - 1, 0), max(_SAMPLES // (columns * period), 1)).astype(int))
    chosen = (strips[:, None] * period + np.arange(period)).ravel()
    chosen = chosen[chosen < rows]
    codes = mosaic.codes[chosen].astype(np.float64)
    difference = codes[:, period:] - codes[:, :-period]
    if not difference.size:
        return difference
    usual = _usual(difference)
    for axis in (0, 1):
        difference -= difference.mean(axis, keepdims=True, where=usual | ~usual.any(axis, keepdims=True))
    difference[~(usual & _usual(difference))] = np.nan
    return difference


def _usual(values: DoubleArray) -> BoolArray:
    """Return which values are no outliers: hot pixels are alike in all frames, and edited ones hide what is alike."""
    low, middle, high = np.quantile(values, (0.16, 0.5, 0.84))
    return np.abs(values - middle) <= _OUTLIER * max((high - low) / 2, 1.0)


def _correlation(one: DoubleArray, other: DoubleArray) -> float:
    both = np.isfinite(one) & np.isfinite(other)
    if not both.any():
        return 0.0
    one, other = one[both] - one[both].mean(), other[both] - other[both].mean()
    size = np.sqrt((one**2).sum() * (other**2).sum())
    return float((one * other).sum() / size) if size > 0 else 0.0
