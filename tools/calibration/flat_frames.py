"""Flat frames together: which of them count, and whether they show the same."""

from collections.abc import Sequence

import numpy as np

from ...shared import Mosaic
from ...shared.arrays import DoubleArray
from ...shared.errors import InputError
from ...shared.shading import ZOOMED
from .samples import CLIPPED, levels_of

Named = tuple[str, Mosaic]
"""A frame after its name."""
_CLIPPED_PART = 2e-3  # of the samples of a plane: more of them, and it is not just defects
_PARTS = 4  # of an axis, in which frames are compared with each other
_UNLIKE = 0.03  # share by which the light of a frame may fall off in another way than that of all together
_COUNTS = 0.1  # of the light of the brightest frame: in dimmer ones, which count little, black level decides how it falls off


def common_focal_length(frames: Sequence[Named]) -> float | None:
    """Return the common focal length of flat frames, millimetres, None if unknown. Raises InputError if they differ."""
    stated = ((frame.metadata.focal_length, name) for name, frame in frames)
    known = sorted((length, name) for length, name in stated if length is not None)
    if not known:
        return None
    (shortest, one), (longest, other) = known[0], known[-1]
    if longest > shortest * (1 + ZOOMED):
        lengths = f"{one} is taken at {shortest:g} mm, {other} at {longest:g} mm"
        raise InputError(f"flat frames: {lengths}; take all at one focal length")
    return shortest


def mean_of_unclipped(frames: Sequence[Named]) -> tuple[DoubleArray, dict[str, DoubleArray]]:
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
        strips = np.add.reduceat(np.where(clear, levels, 0), down, dtype=np.float64)
        parts[name] = np.add.reduceat(strips, right, axis=1)
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
