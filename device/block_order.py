"""The order of the filters in a Bayer block, as far as samples tell: the two greens are equal, red and blue are not."""

import numpy as np

from shared.arrays import CodeArray, DoubleArray
from shared.pattern import CfaPattern

_BLOCKS = 5  # of a group, each way; colours of a scene differ from group to group
_LARGER = 4.0  # times the energy of the difference on the other diagonal
_GROUPS = 16  # fewer do not tell how uncertain their mean is
_BRIGHTER = 4.0  # times the energy that a difference has at a colour site; without colour 9, with one channel alone 1
_LEAST = 3  # period in which no panchromatic pixels lie on a diagonal
_CERTAIN = 5.0  # standard errors


def green_diagonal_is_wrong(codes: CodeArray, pattern: CfaPattern, white_level: int) -> bool:
    """Whether the two greens of `pattern` lie on the other diagonal of its blocks; False where the frame does not tell.

    codes: a frame, (H, W), that shows the pattern at the declared place.
    pattern: any pattern; one whose blocks are not 2 x 2 with one channel on a diagonal is not judged.
    white_level: codes from here on are clipped, and equal for that reason.
    """
    channels = {(row, column): channel for row, column, channel in pattern.sites}
    if set(channels) != {(0, 0), (0, 1), (1, 0), (1, 1)}:
        return False
    pairs = (((0, 0), (1, 1)), ((0, 1), (1, 0)))
    same = [channels[one] == channels[other] for one, other in pairs]
    if sum(same) != 1:
        return False
    ours, others, scene = (
        _difference(codes, pattern, pair, white_level)
        for pair in (
            pairs[same.index(True)],
            pairs[same.index(False)],
            tuple((row + 2, column + 2) for row, column in pairs[same.index(True)]),
        )
    )
    # Two panchromatic samples next to the block differ as much if it is the scene that differs, as stripes do that repeat with K.
    known = max(float(others.mean()), float(scene.mean()) / _BRIGHTER if pattern.period > _LEAST else 0.0, 0.0)
    if ours.size < _GROUPS:
        return False
    error = ours.std(ddof=1) / ours.size**0.5
    return bool(ours.mean() > _CERTAIN * error and ours.mean() > _LARGER * known)


def _difference(codes: CodeArray, pattern: CfaPattern, pair: tuple[tuple[int, int], ...], white_level: int) -> DoubleArray:
    """Squared difference of two sites, mean of each group of blocks, without the part that noise has in it."""
    planes = [
        codes[pattern.block_origin[0] + row :: pattern.period, pattern.block_origin[1] + column :: pattern.period]
        for row, column in pair
    ]
    rows, columns = (min(sizes) // _BLOCKS * _BLOCKS for sizes in zip(*(plane.shape for plane in planes), strict=True))
    one, other = (plane[:rows, :columns].astype(np.float64) for plane in planes)
    difference = np.where((one < white_level) & (other < white_level), one - other, 0.0)
    groups = difference.reshape(rows // _BLOCKS, _BLOCKS, columns // _BLOCKS, _BLOCKS).swapaxes(1, 2).reshape(-1, _BLOCKS**2)
    energy: DoubleArray = np.square(groups.mean(axis=1)) - groups.var(axis=1, ddof=1) / _BLOCKS**2
    return energy
