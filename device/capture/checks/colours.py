"""Which colour sites have which filter, as far as samples tell: those of one channel read the same, and no others do.

So the two greens of a Bayer block show its diagonal, and scattered sites where their tile begins: their panchromatic pixels often
lie as they do for several places of the tile (half of all pixels, as on a checkerboard, leave only two).
"""

from dataclasses import replace

import numpy as np

from shared.arrays import ByteArray, CodeArray, DoubleArray
from shared.calibration import SensorCalibration
from shared.pattern import CfaPattern

from .filters import places_alike

_SIDES = (5, 3, 2)  # tiles of a group, each way: the largest of which there are enough; colours differ from group to group
_GROUPS, _MOST = 16, 32  # with fewer the uncertainty of their mean is unknown; along a side of the frame, enough for any
_LARGER = 3.0  # times the energy of all other differences; in photographs 7 times and more where there is light
_COLOURED = 1 / 8  # of the energy of panchromatic pixels around: a filter passes half the light or less, and sites are nearer
_IMBALANCE = 0.03  # of their level by which sites of one channel may differ
_CERTAIN = 5.0  # standard errors


def shows_colours(codes: CodeArray, pattern: CfaPattern, calibration: SensorCalibration, top: int = 0) -> bool | None:
    """Return whether each colour is at the sites where `pattern` has it; None where the frame does not show it.

    True where no frame can show it: where only channels are exchanged (a chart tells which is red).

    codes: a frame, (H, W), that shows its panchromatic pixels where `pattern` has them. top: sensor row of the first.
    """
    pattern = replace(pattern, origin=((pattern.origin[0] - top) % pattern.period, pattern.origin[1]))
    candidates = [pattern]
    if pattern.is_scattered:
        candidates = [replace(pattern, origin=place) for place in places_alike(pattern, pattern.block_origin)]
    elif len(pattern.sites) == 4 and pattern.block_shape == (2, 2):
        rows = [row[:2][::-1] for row in pattern.letters_from(pattern.block_origin)[:2]]
        candidates.append(CfaPattern.with_block((rows[0], rows[1]), pattern.period, pattern.block_origin, pattern.channels))
    black, white = float(np.mean(calibration.black_level)), calibration.white_level
    first, period = candidates[0], candidates[0].period
    corner = tuple((place - 1) % period for place in first.block_origin)  # a pixel before the block, which then is in one piece
    planes = [pattern.filter_map((period, period), (corner[0], corner[1])).ravel() for pattern in candidates]
    sites = planes[0] < len(first.channels)
    kinds = {(plane[sites, None] == plane[sites]).tobytes(): number for number, plane in reversed([*enumerate(planes)])}
    if len(kinds) == 1:
        return True
    groups = _groups(codes[corner[0] :, corner[1] :], period)
    if groups is None:
        return None
    samples = np.where((groups[..., sites] >= white).any(axis=2, keepdims=True), black, groups[..., sites])
    beside = np.logical_or.reduce([np.roll(sites.reshape(period, -1), (d, r), (0, 1)) for d in (-1, 0, 1) for r in (-1, 0, 1)])
    clear = groups[..., beside.ravel() & ~sites]
    energies = {number: _energy(samples, planes[number][sites]) for number in kinds.values()}
    best = min(energies, key=lambda number: float(energies[number].mean()))
    # What makes sites of one channel differ, the scene or the sensor, is at most as large as this.
    scene = _COLOURED * _energy(clear, np.zeros(clear.shape[2], np.uint8))
    level = np.maximum(samples.mean(axis=(1, 2)) - black, 0.0)
    limit = np.maximum.reduce([energies[best], scene, np.square(_IMBALANCE * level) / 2])
    rivals = [0] if best else [number for number in energies if number != best]
    return best == 0 if all(_exceeds(energies[number], limit) for number in rivals) else None


def _groups(codes: CodeArray, period: int) -> DoubleArray | None:
    """Square groups of tiles, evenly spread: (groups, tiles of a group, K K); None if there are too few."""
    down, across = (size // period for size in codes.shape)
    side = next((side for side in _SIDES if (down // side) * (across // side) >= _GROUPS), 0)
    if not side:
        return None
    rows, columns = down // side, across // side
    whole = codes[: rows * side * period, : columns * side * period].reshape(rows, side, period, columns, side, period)
    some = whole[:: -(-rows // _MOST), :, :, :: -(-columns // _MOST)].transpose(0, 3, 1, 4, 2, 5)
    return some.reshape(-1, side**2, period**2).astype(np.float64)


def _energy(samples: DoubleArray, kinds: ByteArray) -> DoubleArray:
    """Variance of the sites of a kind about their mean, in each group, without the part that noise has in it.

    samples: (groups, tiles, sites). kinds: of each site, (sites,).
    """
    shares = (kinds[:, None] == kinds).astype(float)
    shares /= shares.sum(axis=1, keepdims=True)
    apart = samples - samples @ shares.T
    energy = np.square(apart.mean(axis=1)) - apart.var(axis=1, ddof=1) / samples.shape[1]
    return energy.sum(axis=1) / (len(shares) - np.trace(shares))


def _exceeds(ours: DoubleArray, others: DoubleArray) -> bool:
    """Whether energies of groups are certainly larger than others, by enough for a difference of filters."""
    if ours.mean() <= _LARGER * max(float(others.mean()), 0.0):
        return False
    # Of each group at most 1, so that a few strong colours do not hide how certain the many are.
    votes = (ours - others) / (np.abs(ours) + np.abs(others) + 1e-9)
    return bool(votes.mean() > _CERTAIN * votes.std(ddof=1) / votes.size**0.5)
