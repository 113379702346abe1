"""Frames of one kind together: which of them count, and whether they show the same.

Copies of one another are refused, dark or flat, because their difference shows no noise.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise

import numpy as np

from shared import Mosaic
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError
from shared.shading import ZOOMED

from .samples import CLIPPED, levels_of

_CLIPPED_PART = 2e-3  # of the samples of a plane: more of them, and it is not just defects
_PARTS = 4  # of an axis, in which frames are compared with each other
_UNLIKE = 0.03  # share by which the light of a frame may fall off in another way than that of all together
_COUNTS = 0.1  # of the light of the brightest frame: in dimmer ones, which count little, black level decides how it falls off
# Largest correlation of the noise of two frames. Fixed pattern correlates too: in dark frames it is smaller than the read noise, at
# least without rows and columns; in bright flat frames of large pixels it reaches 0.88 (1 % at 100,000 electrons).
DARK_ALIKE, FLAT_ALIKE = 0.67, 0.9
_SAMPLES = 1 << 20  # of a frame: they decide as well as all of them
_OUTLIER = 5.0  # standard deviations


def common_focal_length(frames: Iterable[tuple[str, float | None]], kind: str) -> float | None:
    """Return the common focal length of frames of a kind, None if unknown. Raises InputError if the frames differ.

    frames: name and focal length, millimetres, of each.
    """
    known = sorted((each, name) for name, each in frames if each is not None)
    if not known:
        return None
    (shortest, one), (longest, other) = known[0], known[-1]
    if longest > shortest * (1 + ZOOMED):
        raise InputError(f"{kind}: {one} is taken at {shortest:g} mm, {other} at {longest:g} mm; take all at one focal length")
    return shortest


def mean_of_unclipped(frames: Sequence[tuple[str, Mosaic]]) -> tuple[DoubleArray, dict[str, DoubleArray]]:
    """Return the mean of the frames that are not clipped, (H, W), and, by name, the panchromatic light in parts of each.

    Raises InputError if all are clipped.
    """
    pattern, shape = frames[0][1].pattern, frames[0][1].shape
    planes, letters = pattern.filter_map(shape), pattern.planes
    number, clear = np.bincount(planes.ravel()), planes == len(letters) - 1
    down, right = (np.linspace(0, length, _PARTS, endpoint=False).astype(int) for length in shape)
    total, parts, clipped = np.zeros(shape), {}, []
    for name, frame in frames:
        levels = levels_of(frame)
        shares = np.bincount(planes[levels >= CLIPPED], minlength=len(letters)) / number
        if shares.max() > _CLIPPED_PART:
            clipped.append((float(shares.max()), letters[int(shares.argmax())], name))
            continue
        total += levels
        parts[name] = np.add.reduceat(np.add.reduceat(np.where(clear, levels, 0), down, dtype=np.float64), right, axis=1)
    if not parts:
        share, letter, name = min(clipped)
        raise InputError(
            f"flat frames: all are clipped; {name} is least so, in {100 * share:.2g} % of the samples of {letter}; expose less, so "
            "that the brightest read about three quarters of full scale"
        )
    return total / len(parts), parts


def check_alike(parts: dict[str, DoubleArray]) -> None:
    """Raise InputError if the light of a frame falls off in another way than that of all; parts: see `mean_of_unclipped`."""
    together = np.sum(list(parts.values()), axis=0)
    brightest = max(part.mean() for part in parts.values())
    for name, part in parts.items():
        if part.mean() < _COUNTS * brightest:
            continue
        unlike = float(np.ptp(part / part.mean() / (together / together.mean())))
        if unlike > _UNLIKE:
            raise InputError(
                f"flat frames: the light of {name} falls off in another way than that of all together, by {100 * unlike:.1f} %, "
                f"{100 * _UNLIKE:.0f} % are allowed; take all with the same lens, focal length, aperture and light"
            )


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
