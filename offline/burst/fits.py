"""From the shifts of tiles to the motion of the frame, and to local shifts where the tiles agree on them."""

from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray

from .tiles import Tiles

_FLOOR = 0.03  # pixels: what a tile says may be wrong by this even without noise: aliasing, filled pixels
_FAR = 9.0  # squared deviations in units of their variance, from which on a tile counts clearly less: something moved there
_ROUNDS = 12
_STEP = 0.15  # pixels: how much local shifts differ from a node to the next
_SWEEPS = 80
_NEAR = 2  # nodes: radius of the window in which tiles are asked whether they agree on local shifts
_LOST, _WON = 0.25, 0.6  # share of the squared deviations that local shifts must explain to be taken at all, and in full


class Step(NamedTuple):
    """A correction to a motion.

    shift: (2,), pixels of the level; angle: radians.
    weights: (R, C), 0 to 1, what each tile counted.
    error: standard deviation of the places in the frame, pixels of the level, root mean square.
    """

    shift: DoubleArray
    angle: float
    weights: DoubleArray
    error: float


def rigid(tiles: Tiles, turn: DoubleArray) -> Step:
    """The correction in which most tiles agree. turn: (2, 2), the motion's rotation."""
    shape = tiles.shifts.shape[:2]
    arm = np.stack(np.broadcast_arrays(tiles.rows[:, None], tiles.columns), axis=-1) @ turn.T
    jacobian = np.zeros((*shape, 2, 3))
    jacobian[..., 0, 0] = jacobian[..., 1, 1] = 1
    jacobian[..., 0, 2], jacobian[..., 1, 2] = -arm[..., 1], arm[..., 0]
    certain, weights = _certain(tiles), np.ones(shape)
    weak = np.diag([1e-6, 1e-6, 1e-6 * np.square(arm).sum(axis=-1).mean()])  # where nothing is known: no correction
    for _ in range(_ROUNDS):
        known = np.einsum("ab,abip,abij,abjq->pq", weights, jacobian, certain, jacobian) + weak
        step = np.linalg.solve(known, np.einsum("ab,abip,abij,abj->p", weights, jacobian, certain, tiles.shifts))
        far = _squared(tiles.shifts - jacobian @ step, certain)
        limit = max(_FAR, 4 * float(np.median(far)))
        weights = (limit / (limit + far)) ** 2  # Geman and McClure
    covariance = np.linalg.inv(known) * max(1.0, float((weights * far).sum() / max(2 * weights.sum(), 1)))
    error = covariance[0, 0] + covariance[1, 1] + covariance[2, 2] * np.square(arm).sum(axis=-1).mean()
    return Step(step[:2], float(step[2]), weights, float(error**0.5))


def local(tiles: Tiles, before: DoubleArray) -> DoubleArray:
    """Local shifts of the nodes, (R, C, 2), pixels of the level: smooth, and 0 where the tiles do not agree on others.

    before: (R, C, 2), local shifts that the tiles were measured with.

    Tiles agree where one half of them, chosen like the squares of a chessboard, predicts what the other half measures.
    """
    certain, shifts = _certain(tiles), tiles.shifts + before
    weights = _counts(tiles.shifts, certain)
    for _ in range(3):
        field = _smooth(shifts, certain * weights[..., None, None])
        weights = _counts(shifts - field, certain)
    odd = np.indices(shifts.shape[:2]).sum(axis=0) % 2
    predicted = np.where(
        odd[..., None],
        _smooth(shifts, certain * (weights * (1 - odd))[..., None, None]),
        _smooth(shifts, certain * (weights * odd)[..., None, None]),
    )
    without, left = _window(weights * _squared(shifts, certain)), _window(weights * _squared(shifts - predicted, certain))
    won = (without - left) / (without + _window(2 * weights))
    taken: DoubleArray = field * np.clip((won - _LOST) / (_WON - _LOST), 0, 1)[..., None]
    return taken


def _certain(tiles: Tiles) -> DoubleArray:
    """The tiles' information, with an error of `_FLOOR` added to each."""
    certain: DoubleArray = np.linalg.solve(np.eye(2) + _FLOOR**2 * tiles.information, tiles.information)
    return certain


def _squared(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """Squared deviations in units of their variance: (R, C)."""
    squared: DoubleArray = np.einsum("abi,abij,abj->ab", shifts, information, shifts)
    return squared


def _counts(shifts: DoubleArray, certain: DoubleArray) -> DoubleArray:
    far = _squared(shifts, certain)
    weights: DoubleArray = (4 * _FAR / (4 * _FAR + far)) ** 2
    return weights


def _smooth(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """The shifts that fit the tiles' and differ little from node to node. Far from any texture they stay 0."""
    tie = 1 / _STEP**2
    inverse = np.linalg.inv(information + 4 * tie * np.eye(2))
    wanted = (information @ shifts[..., None])[..., 0]
    field: DoubleArray = np.zeros_like(shifts)
    for _ in range(_SWEEPS):
        wide = np.pad(field, ((1, 1), (1, 1), (0, 0)), mode="edge")
        around = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
        field = (inverse @ (wanted + tie * around)[..., None])[..., 0]
    return field


def _window(values: DoubleArray) -> DoubleArray:
    """Sums over the window around each node."""
    for axis in (0, 1):
        wide = np.pad(values, [(_NEAR, _NEAR) if each == axis else (0, 0) for each in (0, 1)])
        values = np.lib.stride_tricks.sliding_window_view(wide, 2 * _NEAR + 1, axis=axis).sum(axis=-1)
    return values
