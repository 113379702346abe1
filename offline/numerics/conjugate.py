"""Conjugate gradients on a region of the graph of neighbouring pixels, three fields together (see `fields`).

The system is scaled by the square roots of its diagonal. This is the usual diagonal preconditioning, without a diagonal to read. An
iteration passes over the rows once: it updates a row of solution, residual and direction, then applies the matrix to the row above,
whose three rows of directions are still in the cache.
"""

import math

import numpy as np

from .arrays import Doubles2, Floats1, Floats3, Pair, Scalar
from .compile import kernel
from .functions import zeros
from .lanes import WIDTH, Lanes, load, store, total

SOLVED = 3
"""Fields that are solved; the fourth is one minus their sum."""
MARGIN = WIDTH
"""Columns of a region's planes left of its first column; as many and up to one vector more follow its last."""
RESIDUAL, DIRECTION, APPLIED = SOLVED, 2 * SOLVED, 3 * SOLVED
"""Planes of the unknowns, after the solutions."""
_ZERO = np.float32(0)


@kernel
def conjugate_gradients(
    weights: Floats3, size: Pair, planes: Floats3, norm: float, tolerance: float, iterations: int
) -> tuple[float, int]:
    """Solve, starting from the residuals in `planes`. Returns the largest relative residual, and the iterations used.

    planes: solution, residual, direction and the matrix times the direction, three fields each, (12, rows + 2, width).
    norm: the largest squared norm of a right-hand side.
    """
    target = tolerance * tolerance * norm
    steps, turns = np.zeros(SOLVED, np.float32), np.zeros(SOLVED, np.float32)
    sums = np.empty((SOLVED, 4))
    worst, used = 0.0, 0
    while used < iterations:
        _sweep(weights, size, planes, used == 0, steps, turns, sums)
        worst, solved = 0.0, True
        for field in range(SOLVED):
            worst, solved = max(worst, sums[field, 0]), solved and sums[field, 0] <= target
        if solved:
            return math.sqrt(worst / norm) if norm > 0 else 0.0, used
        used += 1
        certain = True
        worst = 0.0
        for field in range(SOLVED):
            squared, curvature, applied, mixed = sums[field]
            step = squared / curvature if curvature > 0 else 0.0
            # The squared norm of the next residual, before it is computed: this makes one pass per iteration enough.
            following = max(squared - 2 * step * mixed + step * step * applied, 0.0)
            certain = certain and (squared <= target or following > 1e-3 * squared)
            worst = max(worst, following)
            steps[field], turns[field] = step, following / squared if squared > 0 else 0.0
        if worst <= target and certain:  # if it is not certain, rounding may have made it small: the next sweep measures it
            break
    for field in range(SOLVED):
        for row in range(1, size[0] + 1):
            for column in range(MARGIN, MARGIN + size[1], WIDTH):
                step = steps[field] * load(planes, (DIRECTION + field, row, column))
                store(planes, (field, row, column), load(planes, (field, row, column)) + step)
    return math.sqrt(worst / norm), used


@kernel
def _sweep(weights: Floats3, size: Pair, planes: Floats3, first: bool, steps: Floats1, turns: Floats1, sums: Doubles2) -> None:
    """Run one iteration. sums: per field (r, r), (p, Ap), (Ap, Ap), (r, Ap) of the residual r and the direction p it ends with."""
    parts = zeros(SOLVED, 4, WIDTH)
    for row in range(size[0] + 1):
        if row < size[0]:
            if first:
                _begin(planes, row + 1, size[1], parts)
            else:
                _update(planes, row + 1, size[1], steps, turns, parts)
        if row > 0:
            _apply(weights, planes, row, size[1], parts)
    for field in range(SOLVED):
        for part in range(4):
            sums[field, part] = total(load(parts, (field, part, 0)))


@kernel
def _begin(planes: Floats3, row: int, columns: int, parts: Floats3) -> None:
    """Set solution and direction of one row from its residual, and add its (r, r) to `parts`."""
    for field in range(SOLVED):
        squared = load(parts, (field, 0, 0))
        for column in range(MARGIN, MARGIN + columns, WIDTH):
            residual = load(planes, (RESIDUAL + field, row, column))
            store(planes, (field, row, column), _ZERO * residual)
            store(planes, (DIRECTION + field, row, column), residual)
            squared += residual * residual
        store(parts, (field, 0, 0), squared)


@kernel
def _update(planes: Floats3, row: int, columns: int, steps: Floats1, turns: Floats1, parts: Floats3) -> None:
    """Advance solution, residual and direction of one row, and add its (r, r) to `parts`."""
    for field in range(SOLVED):
        step, turn = steps[field], turns[field]
        squared = load(parts, (field, 0, 0))
        for column in range(MARGIN, MARGIN + columns, WIDTH):
            direction = load(planes, (DIRECTION + field, row, column))
            store(planes, (field, row, column), load(planes, (field, row, column)) + step * direction)
            residual = load(planes, (RESIDUAL + field, row, column)) - step * load(planes, (APPLIED + field, row, column))
            store(planes, (RESIDUAL + field, row, column), residual)
            store(planes, (DIRECTION + field, row, column), residual + turn * direction)
            squared += residual * residual
        store(parts, (field, 0, 0), squared)


@kernel
def _apply(weights: Floats3, planes: Floats3, row: int, columns: int, parts: Floats3) -> None:
    """Apply the matrix to the directions of one row, and add its other three products to `parts`."""
    for field in range(SOLVED):
        plane = DIRECTION + field
        curvature, applied, mixed = load(parts, (field, 1, 0)), load(parts, (field, 2, 0)), load(parts, (field, 3, 0))
        for column in range(MARGIN, MARGIN + columns, WIDTH):
            direction = load(planes, (plane, row, column))
            near = (  # not moved from lane to lane: on AVX2 that takes longer than reading them again
                load(planes, (plane, row, column + 1)), load(planes, (plane, row, column - 1)),
                load(planes, (plane, row + 1, column)), load(planes, (plane, row - 1, column)),
                load(planes, (plane, row + 1, column + 1)), load(planes, (plane, row - 1, column - 1)),
                load(planes, (plane, row + 1, column - 1)), load(planes, (plane, row - 1, column + 1)),
            )  # fmt: skip
            product = direction - around(weights, row, column, near)
            store(planes, (APPLIED + field, row, column), product)
            curvature += direction * product
            applied += product * product
            mixed += load(planes, (RESIDUAL + field, row, column)) * product
        store(parts, (field, 1, 0), curvature)
        store(parts, (field, 2, 0), applied)
        store(parts, (field, 3, 0), mixed)


@kernel
def around(weights: Floats3, row: int, column: int, near: tuple[Lanes | Scalar, ...]) -> Lanes:
    """The sum over eight neighbours of c[n, n'] times a value at n', in the order of their names here."""
    right, left, below, above, below_right, above_left, below_left, above_right = near
    return (
        load(weights, (0, row, column)) * right
        + load(weights, (0, row, column - 1)) * left
        + load(weights, (1, row, column)) * below
        + load(weights, (1, row - 1, column)) * above
        + load(weights, (2, row, column)) * below_right
        + load(weights, (2, row - 1, column - 1)) * above_left
        + load(weights, (3, row, column)) * below_left
        + load(weights, (3, row - 1, column + 1)) * above_right
    )
