"""The order of the filters in a Bayer block, as far as samples tell: its two greens are equal, its red and blue are not."""

import numpy as np

from shared.arrays import CodeArray, DoubleArray, FloatArray
from shared.pattern import CfaPattern

_SIDES = (5, 3, 2)  # blocks of a group, each way: the largest of which there are enough; colours differ from group to group
_GROUPS = 16  # with fewer the uncertainty of their mean is unknown
_LARGER = 3.0  # times the energy of all other differences; in photographs 7 times and more where there is light
_COLOURED = 1 / 4  # of the energy of a panchromatic difference at most: a filter passes half the light, or less
_IMBALANCE = 0.03  # of their level by which the two greens of a sensor may differ
_CERTAIN = 5.0  # standard errors
_DIAGONALS = (((0, 0), (1, 1)), ((0, 1), (1, 0)))
_BESIDE = ((((1, -1), (2, 0)), ((-1, 1), (0, 2))), (((-1, 0), (0, -1)), ((1, 2), (2, 1))))  # panchromatic at every period

Pair = tuple[tuple[int, int], tuple[int, int]]


def greens_are_on_their_diagonal(codes: CodeArray, pattern: CfaPattern, black_level: float, white_level: int) -> bool | None:
    """Whether the two greens of `pattern` are on the declared diagonal of its blocks; None where the frame does not show it.

    True for patterns without a block of 2 x 2 that has one channel on a diagonal: there is nothing to tell.

    codes: a frame, (H, W), that shows the pattern at the declared place.
    black_level: mean code without light.
    white_level: codes from here on are clipped, and equal for that reason.
    """
    channels = {(row, column): channel for row, column, channel in pattern.sites}
    if set(channels) != {(0, 0), (0, 1), (1, 0), (1, 1)}:
        return True
    alike = [channels[one] == channels[other] for one, other in _DIAGONALS]
    if sum(alike) != 1:
        return True
    blocks = _Blocks(codes, pattern, black_level, white_level)
    if not blocks.side:
        return None
    energies = [blocks.energy(pair) for pair in _DIAGONALS]
    scenes = [_COLOURED * np.mean([blocks.energy(pair) for pair in pairs], axis=0) for pairs in _BESIDE]
    imbalance = np.square(_IMBALANCE * blocks.level())
    greens = alike.index(True)
    # Whatever makes the greens differ, an edge or the sensor, is at most as large as this.
    for diagonal, answer in ((1 - greens, True), (greens, False)):
        if exceeds(energies[diagonal], np.maximum.reduce([energies[1 - diagonal], scenes[diagonal], imbalance])):
            return answer
    return None


def exceeds(ours: DoubleArray, others: DoubleArray) -> bool:
    """Whether energies of groups are certainly larger than others, by enough for a difference of filters."""
    if ours.mean() <= _LARGER * max(float(others.mean()), 0.0):
        return False
    # Of each group at most 1, so that a few strong colours do not hide how certain the many are.
    votes = (ours - others) / (np.abs(ours) + np.abs(others) + 1e-9)
    return bool(votes.mean() > _CERTAIN * votes.std(ddof=1) / votes.size**0.5)


class _Blocks:
    """The blocks of a frame, in square groups. side: blocks of a group, each way; 0 where there are too few."""

    def __init__(self, codes: CodeArray, pattern: CfaPattern, black_level: float, white_level: int) -> None:
        self._codes, self._black, self._white = codes, black_level, white_level
        self._period = pattern.period
        # From the second block on, because the pairs beside a block begin before it; the last has to end in the frame as well.
        self._origin = [origin + pattern.period for origin in pattern.block_origin]
        self._count = [
            max((size - first - 3) // self._period + 1, 0) for size, first in zip(codes.shape, self._origin, strict=True)
        ]
        groups = {side: (self._count[0] // side) * (self._count[1] // side) for side in _SIDES}
        self.side = next((side for side, number in groups.items() if number >= _GROUPS), 0)

    def energy(self, pair: Pair) -> DoubleArray:
        """Squared difference of two pixels of a block, mean of each group, without the part that noise has in it."""
        one, other = (self._plane(place) for place in pair)
        groups = self._grouped(np.where((one < self._white) & (other < self._white), one - other, 0.0))
        energy: DoubleArray = np.square(groups.mean(axis=1)) - groups.var(axis=1, ddof=1) / self.side**2
        return energy

    def level(self) -> DoubleArray:
        """Mean of the colour samples above black, of each group."""
        samples = np.mean([self._plane(place) for pair in _DIAGONALS for place in pair], axis=0)
        level: DoubleArray = self._grouped(samples).mean(axis=1)
        return np.maximum(level - self._black, 0.0)

    def _plane(self, place: tuple[int, int]) -> FloatArray:
        rows, columns = (
            slice(origin + step, origin + step + self._period * count, self._period)
            for origin, step, count in zip(self._origin, place, self._count, strict=True)
        )
        return self._codes[rows, columns].astype(np.float32)

    def _grouped(self, plane: FloatArray) -> DoubleArray:
        side = self.side
        rows, columns = (size // side for size in plane.shape)
        whole = plane[: rows * side, : columns * side].astype(np.float64)
        return whole.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(-1, side**2)
