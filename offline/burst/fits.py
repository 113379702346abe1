"""From the shifts of tiles to the motion of the frame, and to local shifts where the tiles agree on them."""

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.ndimage import uniform_filter
from scipy.sparse.linalg import cg

from shared.arrays import DoubleArray
from shared.errors import InputError

from .tiles import Tiles

# Chosen on drawn scenes: half and twice change parallax by 0.02 dB at most, or as said.
_FLOOR = 0.03  # pixels: error of a tile's shift even without noise, from aliasing and filled pixels
_FAR = 9.0  # squared deviations in units of their variance, from which on a tile counts clearly less: something moved there
_ROUNDS = 12  # iterations of the reweighted fit
_STEP = 0.3  # pixels: how much local shifts differ from a node to the next (0.3 dB)
_LOCAL_ROUNDS = 3  # rounds as above for local shifts
_TOLERANCE, _ITERATIONS = 1e-3, 200  # of conjugate gradients: relative residual, and most iterations; four photographs took 15
_VAGUE = 0.25  # pixels: a tile with this uncertainty has half the weight of a certain one
_NEAR = 2  # nodes: radius of the window in which local shifts are cross-validated
_OVERALL = 0.02  # weight of all other tiles there
_LOST, _WON = (
    0.4,
    0.7,
)  # share of a window's squared deviations that local shifts must explain to be taken at all, and in full (1.8 dB)
_LEAST = 0.2  # that share of all
_TINY = 1e-30  # keeps quotients finite


class Step(NamedTuple):
    """A correction to a motion.

    shift: (2,), pixels of the level; angle: radians.
    error: standard deviation of the places in the frame, pixels of the level, root mean square.
    """

    shift: DoubleArray
    angle: float
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
    each = np.swapaxes(jacobian, -1, -2) @ certain
    each_known, each_wanted = each @ jacobian, _times(each, tiles.shifts)
    for _ in range(_ROUNDS):
        known = np.einsum("ab,abpq->pq", weights, each_known) + weak
        step = np.linalg.solve(known, np.einsum("ab,abp->p", weights, each_wanted))
        far = _squared(tiles.shifts - jacobian @ step, certain)
        weights = _counts(far)
    covariance = np.linalg.inv(known) * max(1.0, float((weights * far).sum() / max(2 * weights.sum(), 1)))
    error = covariance[0, 0] + covariance[1, 1] + covariance[2, 2] * np.square(arm).sum(axis=-1).mean()
    return Step(step[:2], float(step[2]), float(error**0.5))


def local(tiles: Tiles, before: DoubleArray) -> DoubleArray:
    """Local shifts of the nodes, (R, C, 2), pixels of the level: smooth, and 0 where the tiles do not agree on others.

    before: (R, C, 2), local shifts that the tiles were measured with.

    Tiles agree where one half of them, chosen like the squares of a chessboard, predicts what the other half measures.
    """
    certain, shifts = _certain(tiles), tiles.shifts + before
    weights, field = np.ones(shifts.shape[:2]), before
    for _ in range(_LOCAL_ROUNDS):
        field = _smooth(shifts, certain * weights[..., None, None], field)
        weights = _counts(_squared(shifts - field, certain))
    odd = np.indices(weights.shape).sum(axis=0) % 2
    halves = [_smooth(shifts, certain * (weights * half)[..., None, None], np.zeros_like(field)) for half in (1 - odd, odd)]
    predicted = np.where(odd[..., None], *halves)
    vague = np.eye(2) / _VAGUE**2
    freedom = np.trace(np.linalg.solve(certain + vague, certain), axis1=2, axis2=3)  # 2, less where there is little texture
    without, left = (weights * _squared(rest, certain) for rest in (shifts, shifts - predicted))
    won, most = without - left, without + weights * freedom
    if won.sum() <= _LEAST * most.sum():
        return np.zeros_like(field)  # some windows out of many would agree by chance
    won = _window(won) / np.maximum(_window(most), _TINY)
    return field * np.clip((won - _LOST) / (_WON - _LOST), 0, 1)[..., None]


def _certain(tiles: Tiles) -> DoubleArray:
    """The tiles' information, with an error of `_FLOOR` added to each."""
    return np.asarray(np.linalg.solve(np.eye(2) + _FLOOR**2 * tiles.information, tiles.information), np.float64)


def _squared(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """Squared deviations in units of their variance: (R, C)."""
    return (shifts * _times(information, shifts)).sum(axis=-1)


def _counts(far: DoubleArray) -> DoubleArray:
    """Weights of tiles by squared deviations in units of their variance, as by Geman and McClure."""
    limit = max(_FAR, 4 * float(np.median(far)))
    return (limit / (limit + far)) ** 2


def _smooth(shifts: DoubleArray, information: DoubleArray, guess: DoubleArray) -> DoubleArray:
    """The shifts that fit the tiles' and differ little from node to node: conjugate gradients from a guess.

    Raises InputError if they do not reach their tolerance.
    """
    rows, columns = (sparse.diags([-1.0, 1.0], [0, 1], (count - 1, count)) for count in shifts.shape[:2])
    down, across = sparse.kron(rows, sparse.eye(shifts.shape[1])), sparse.kron(sparse.eye(shifts.shape[0]), columns)
    tie = sparse.kron(down.T @ down + across.T @ across, sparse.eye(2) / _STEP**2)
    matrix = (tie + _blocks(information)).tocsr()
    inverse = _blocks(np.asarray(np.linalg.inv(information + 4 * np.eye(2) / _STEP**2), np.float64))
    right = _times(information, shifts).ravel()
    field, missed = cg(matrix, right, guess.ravel(), rtol=_TOLERANCE, maxiter=_ITERATIONS, M=inverse)
    if missed:
        raise InputError(f"cannot be aligned: its local shifts are not found in {_ITERATIONS} iterations")
    return field.reshape(shifts.shape)


def _blocks(matrices: DoubleArray) -> Any:
    """A block-diagonal matrix of matrices (R, C, 2, 2)."""
    count = matrices[..., 0, 0].size
    return sparse.bsr_matrix((matrices.reshape(count, 2, 2), np.arange(count), np.arange(count + 1)))


def _times(matrices: DoubleArray, vectors: DoubleArray) -> DoubleArray:
    return matrices[..., 0] * vectors[..., :1] + matrices[..., 1] * vectors[..., 1:]


def _window(values: DoubleArray) -> DoubleArray:
    """Sums over the window around each node, and a little of the sum over all: what decides where a window holds no texture."""
    size = 2 * _NEAR + 1
    return size**2 * uniform_filter(values, size, mode="constant") + _OVERALL * values.sum()
