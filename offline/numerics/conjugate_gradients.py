"""Conjugate gradients for fields on a graph that joins every pixel to its eight neighbours.

Fields x_f of a rectangle solve, at every pixel n with its neighbours n',

    diagonal_f[n] x_f[n] - sum_n' link[n, n'] x_f[n'] = right side_f[n].

The preconditioner is the diagonal; equations may come scaled to a diagonal of one, so that there is
none to read. Every field takes steps of its own.

A rectangle lies in planes with two rows of zeros above and below. Rows follow each other without a
gap: the neighbours of an element lie at constant distances from it, and those beyond the left and
right edge belong to other rows, so that links to them have to be zero. Links are read once for
`TOGETHER` fields. Sums run down columns first: compilers vectorise that without changing the order.
Indices are unsigned: a signed one is tested for being negative, which keeps loops from being
vectorised.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ...shared.arrays import DoubleArray, FloatArray, IndexArray, Pair
from ...shared.errors import ConvergenceError
from .arrays import Floats1, Floats2, Floats3, Scalar
from .compile import ONE, ZERO, kernel
from .functions import unset, zeros

TOGETHER = 3
"""Fields that are multiplied together; their number is a multiple of it, those too many are
zero.
"""
BORDER = 2
"""Rows of zeros above a rectangle, and below it."""
_WIDTH = 16  # elements: rows are a multiple of it, so that loops over them have no rest
Index = np.unsignedinteger[Any]
Steps = tuple[Index, Index]
"""Elements from a row to the next, and from a plane to the next."""
_NEXT = np.uintp(1)


class System(NamedTuple):
    """The equations.

    Attributes
    ----------
    links : Floats3
        (4, ...), 0 or more, from each pixel to the one on its right, below, below right and below
        left.
    diagonal : Floats3
        (F, ...), or none: 1.
    """

    links: Floats3
    diagonal: Floats3


class Limits(NamedTuple):
    """Bounds of a solver.

    Attributes
    ----------
    tolerance : float
        Norm of the residual that is small enough, relative to a given one.
    iterations : int
        The most that are allowed.
    """

    tolerance: float
    iterations: int


@kernel
def planes(count: int, size: Pair) -> FloatArray:
    """Planes for a rectangle of some rows and columns: zero around it, arbitrary in it."""
    rows, columns = size
    result = unset(count, rows + 2 * BORDER, (columns + _WIDTH - 1) // _WIDTH * _WIDTH)
    for plane in range(count):
        for row in range(result.shape[1]):
            result[plane, row, columns if BORDER <= row < BORDER + rows else 0 :] = ZERO
    return result


@kernel
def cut(links: Floats3, size: Pair) -> None:
    """Set to zero the links that lead out of a rectangle."""
    rows, columns = size
    for row in range(BORDER, BORDER + rows):
        links[:, row, columns:] = ZERO
        links[0, row, columns - 1] = links[2, row, columns - 1] = links[3, row, 0] = ZERO
    links[1:, BORDER + rows - 1] = ZERO


@kernel
def linked_sum(links: Floats3, values: Floats2, out: Floats2) -> None:
    """Write the sum of the neighbours' values, each times the link to it."""
    flat, x, sums = links.reshape(-1), values.reshape(-1), out.reshape(-1)
    _, rows, width = links.shape
    steps = np.uintp(width), np.uintp(rows * width)
    for place in range(BORDER * width, (rows - BORDER) * width):
        index = np.uintp(place)
        sums[index] = _around(flat, index, x, index, steps)


@kernel
def product(one: Floats2, other: Floats2) -> float:
    """The sum of the products of two planes' elements."""
    a, b, (rows, width), sums = one.reshape(-1), other.reshape(-1), one.shape, zeros(one.shape[1])
    for row in range(BORDER, rows - BORDER):
        for column in range(width):
            index = np.uintp(row * width) + np.uintp(column)
            sums[column] += a[index] * b[index]
    return _total(sums)


@kernel
def solve(
    system: System, residual: Floats3, solution: Floats3, limits: Limits, norm: float
) -> tuple[float, int]:
    """Improve a solution until its residual is small enough.

    NaN if a value is not finite.

    Parameters
    ----------
    residual : Floats3
        (F, ...), right side minus matrix times `solution`; changed.
    solution : Floats3
        (F, ...), changed.
    norm : float
        Squared norm to which the largest residual is relative, in that of the preconditioner; 0 =
        that of the start.

    Returns
    -------
    tuple[float, int]
        The norm of the largest residual, relative to `norm`, and the iterations used.
    """
    count, scaled = len(residual), len(system.diagonal) == 0
    # Together, so that planes do not lie a multiple of a page apart: those would share lines of the
    # cache.
    work = zeros((2 if scaled else 3) * count, *residual.shape[1:])
    direction, applied = work[:count], work[count : 2 * count]
    better = residual if scaled else work[2 * count :]
    diagonal, inverse = system.diagonal.reshape(-1), unset(system.diagonal.size)
    for index in range(len(inverse)):
        inverse[index] = ONE / diagonal[index] if diagonal[index] > ZERO else ZERO
    steps, squared, before = np.zeros(count), np.zeros(count), np.zeros(count)
    used = 0
    while True:
        for field in range(count):
            step = np.float32(steps[field])
            squared[field] = _advance(
                solution[field], residual[field], direction[field], applied[field], step
            )
        if not scaled:
            r, z = residual.reshape(-1), better.reshape(-1)
            for index in range(len(z)):
                z[index] = inverse[index] * r[index]
            for field in range(count):
                squared[field] = product(residual[field], better[field])
        worst = squared.max()  # NaN if one is
        norm = norm if norm > 0 else worst
        if used == limits.iterations or not worst > limits.tolerance**2 * norm:
            return math.sqrt(worst / norm) if norm != 0 else 0.0, used
        used += 1
        for field in range(count):
            turn = np.float32(squared[field] / before[field] if before[field] > 0 else 0)
            p, z = direction[field].reshape(-1), better[field].reshape(-1)
            for index in range(len(p)):  # towards the preconditioned residual
                p[index] = z[index] + turn * p[index]
        _multiply(system.links, ONE if scaled else ZERO, direction, applied)
        if not scaled:
            p, sums = direction.reshape(-1), applied.reshape(-1)
            for index in range(len(sums)):
                sums[index] += diagonal[index] * p[index]
        for field in range(count):
            curvature = product(direction[field], applied[field])
            steps[field] = squared[field] / curvature if curvature != 0 else 0
            before[field] = squared[field]


@kernel
def _total(sums: Floats1) -> float:
    """The sum of a line, always in the same order."""
    total = 0.0
    for value in sums:
        total += value
    return total


@kernel
def _multiply(links: Floats3, diagonal: Scalar, values: Floats3, product: Floats3) -> None:
    """Write a constant diagonal times fields, less what is linked to them, to `product`."""
    (count, rows, width), flat = values.shape, links.reshape(-1)
    plane = np.uintp(rows * width)
    steps = np.uintp(width), plane
    for group in range(0, count, TOGETHER):
        x = values[group : group + TOGETHER].reshape(-1)
        out = product[group : group + TOGETHER].reshape(-1)
        for place in range(BORDER * width, (rows - BORDER) * width):
            first = np.uintp(place)
            second, third = first + plane, first + plane + plane
            one = diagonal * x[first] - _around(flat, first, x, first, steps)
            two = diagonal * x[second] - _around(flat, first, x, second, steps)
            three = diagonal * x[third] - _around(flat, first, x, third, steps)
            out[first], out[second], out[third] = one, two, three


@kernel
def _around(links: Floats1, pixel: Index, values: Floats1, index: Index, steps: Steps) -> Scalar:
    """The sum of the neighbours' values, each times its link.

    pixel, index: of the pixel in a plane of links, and in the values.
    """
    below, plane = steps
    down, right, left = pixel + plane, pixel + plane + plane, pixel + plane + plane + plane
    return (
        links[pixel] * values[index + _NEXT]
        + links[pixel - _NEXT] * values[index - _NEXT]
        + links[down] * values[index + below]
        + links[down - below] * values[index - below]
        + links[right] * values[index + below + _NEXT]
        + links[right - below - _NEXT] * values[index - below - _NEXT]
        + links[left] * values[index + below - _NEXT]
        + links[left - below + _NEXT] * values[index - below + _NEXT]
    )


@kernel
def _advance(
    solution: Floats2, residual: Floats2, direction: Floats2, applied: Floats2, step: Scalar
) -> float:
    """Go a step. Returns the square of the residual."""
    x, r = solution.reshape(-1), residual.reshape(-1)
    p, q = direction.reshape(-1), applied.reshape(-1)
    (rows, width), sums = solution.shape, zeros(solution.shape[1])
    for row in range(BORDER, rows - BORDER):
        for column in range(width):
            index = np.uintp(row * width) + np.uintp(column)
            x[index] += step * p[index]
            rest = r[index] - step * q[index]
            r[index] = rest
            sums[column] += rest * rest
    return _total(sums)


def check_convergence(solver: str, used: IndexArray, residuals: DoubleArray, limit: float) -> None:
    """Raise ConvergenceError if conjugate gradients did not reach their tolerance in one of several
    systems.

    Parameters
    ----------
    solver : str
        Its name.
    used, residuals : IndexArray, DoubleArray
        (systems,), iterations and relative residual of each, one or more.
    limit : float
        Residual at which they were to stop.
    """
    worst = float(residuals.max())
    if not worst <= limit:
        stopped = f"stopped at a relative residual of {worst:.1e} after {used.max()} iterations"
        raise ConvergenceError(f"{solver}: conjugate gradients {stopped}, short of {limit:.1e}")
