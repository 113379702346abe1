"""Conjugate gradients for fields on a graph that joins every pixel to its eight neighbours.

Fields x_f of a region solve, at every pixel n with its neighbours n',

    diagonal_f[n] x_f[n] - sum_n' link[n, n'] x_f[n'] + sum_g coupling_fg[n] x_g[n] = right side_f[n].

The preconditioner is the diagonal; equations may come scaled to a diagonal of one, so that there is none to read. Coupled fields
take a common step, others steps of their own. For coupled ones the preconditioner has a second level (additive Schwarz: Dryja and
Widlund 1987), the same equations for fields that are constant on each of some squares, solved directly: in bursts with much noise
each sample influences hundreds of pixels, which takes 900 iterations without it, and 100 with it. Others are faster without it.

A region lies in planes with two rows of zeros above and below. Rows follow each other without a gap: the neighbours of an element
lie at constant distances from it, and those beyond the left and right edge belong to other rows, so that links to them have to be
zero. Links are read once for `TOGETHER` fields. Sums run down columns first: compilers vectorise that without changing the order.
Indices are unsigned: a signed one is tested for being negative, which keeps loops from being vectorised.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from shared.arrays import FloatArray

from .arrays import Doubles1, Doubles2, Doubles3, Floats1, Floats2, Floats3, Pair, Scalar
from .compile import kernel
from .functions import unset, zeros

TOGETHER = 3
"""Fields that are multiplied together; their number is a multiple of it, those too many are zero."""
BORDER = 2
"""Rows of zeros above a region, and below it."""
_WIDTH = 16  # elements: rows are a multiple of it, so that loops over them have no rest
_SQUARE = 8  # pixels: side of the squares; chosen for speed
Unsigned = np.unsignedinteger[Any]
_ZERO, _ONE, _NEXT = np.float32(0), np.float32(1), np.uintp(1)


class System(NamedTuple):
    """The equations.

    links: (4, ...), 0 or more, from each pixel to the one on its right, below, below right and below left.
    diagonal: (F, ...), or none: 1.
    coupling: (F (F - 1) / 2, ...), of fields 0 and 1, 0 and 2 ... 1 and 2 ..., or none.
    """

    links: Floats3
    diagonal: Floats3
    coupling: Floats3


class Limits(NamedTuple):
    """Bounds of a solver.

    tolerance: norm of the residual that is small enough, relative to a given one.
    iterations: the most that are allowed.
    """

    tolerance: float
    iterations: int


class Edges(NamedTuple):
    """Weights of a pixel's links to its neighbours."""

    right: Scalar
    left: Scalar
    below: Scalar
    above: Scalar
    below_right: Scalar
    above_left: Scalar
    below_left: Scalar
    above_right: Scalar


@kernel
def planes(count: int, size: Pair) -> FloatArray:
    """Planes for a region of some rows and columns: zero around it, arbitrary in it."""
    rows, columns = size
    result = unset(count, rows + 2 * BORDER, (columns + _WIDTH - 1) // _WIDTH * _WIDTH)
    for plane in range(count):
        for row in range(result.shape[1]):
            result[plane, row, columns if BORDER <= row < BORDER + rows else 0 :] = _ZERO
    return result


@kernel
def cut(links: Floats3, size: Pair) -> None:
    """Set to zero the links that lead out of a region."""
    rows, columns = size
    for row in range(BORDER, BORDER + rows):
        links[:, row, columns:] = _ZERO
        links[0, row, columns - 1] = links[2, row, columns - 1] = links[3, row, 0] = _ZERO
    links[1:, BORDER + rows - 1] = _ZERO


@kernel
def linked_sum(links: Floats3, values: Floats2, out: Floats2) -> None:
    """Write the sum of the neighbours' values, each times the link to it."""
    flat, x, sums, (_, rows, width) = links.reshape(-1), values.reshape(-1), out.reshape(-1), links.shape
    below, plane = np.uintp(width), np.uintp(rows * width)
    for row in range(BORDER, rows - BORDER):
        for column in range(width):
            index = np.uintp(row * width) + np.uintp(column)
            sums[index] = _around(_edges(flat, index, below, plane), x, index, below)


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
def solve(system: System, residual: Floats3, solution: Floats3, limits: Limits, norm: float) -> tuple[float, int]:
    """Improve a solution until its residual is small enough.

    residual: (F, ...), right side minus matrix times `solution`; changed.
    solution: (F, ...), changed.
    norm: squared norm to which the largest residual is relative, in that of the preconditioner; 0 = that of the start.
    Returns the norm of the largest residual, relative to `norm`, and the iterations used. NaN if a value is not finite.
    """
    count, scaled, joint = len(residual), len(system.diagonal) == 0, len(system.coupling) > 0
    # Together, so that planes do not lie a multiple of a page apart: those would share lines of the cache.
    work = zeros((2 if scaled else 3) * count, *residual.shape[1:])
    direction, applied, better = work[:count], work[count : 2 * count], residual if scaled else work[2 * count :]
    inverse, factors = _inverses(system.diagonal), _factors(system) if joint else np.zeros((count, 0, 0))
    steps, squared, before, curvature = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    used = 0
    while True:
        for field in range(count):
            step = np.float32(steps[field])
            squared[field] = _advance(solution[field], residual[field], direction[field], applied[field], step)
            if not scaled:
                _precondition(residual[field], inverse[field], factors[field], better[field])
                squared[field] = product(residual[field], better[field])
        worst = _largest(squared, joint)
        norm = norm if norm > 0 else worst
        if used == limits.iterations or not worst > limits.tolerance**2 * norm:
            return math.sqrt(worst / norm) if norm != 0 else 0.0, used
        used += 1
        for field in range(count):
            _turn(direction[field], better[field], np.float32(squared[field] / before[field] if before[field] > 0 else 0))
        _multiply(system.links, _ONE if scaled else _ZERO, direction, applied)
        if not scaled:
            _add_diagonal(system, direction, applied)
        for field in range(count):
            curvature[field] = product(direction[field], applied[field])
        _largest(curvature, joint)
        for field in range(count):
            steps[field] = squared[field] / curvature[field] if curvature[field] != 0 else 0
            before[field] = squared[field]


@kernel
def _largest(products: Doubles1, joint: bool) -> float:
    """The largest product of a field, NaN if one is. Products of coupled fields become their sum."""
    total = largest = 0.0
    for value in products:
        total += value
        if value > largest or math.isnan(value):
            largest = value
    for field in range(len(products) if joint else 0):
        products[field] = total
    return total if joint else largest


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
    below, plane = np.uintp(width), np.uintp(rows * width)
    for group in range(0, count, TOGETHER):
        x, out = values[group : group + TOGETHER].reshape(-1), product[group : group + TOGETHER].reshape(-1)
        for row in range(BORDER, rows - BORDER):
            for column in range(width):
                first = np.uintp(row * width) + np.uintp(column)
                second, third = first + plane, first + plane + plane
                edges = _edges(flat, first, below, plane)
                one = diagonal * x[first] - _around(edges, x, first, below)
                two = diagonal * x[second] - _around(edges, x, second, below)
                three = diagonal * x[third] - _around(edges, x, third, below)
                out[first] = one
                out[second] = two
                out[third] = three


@kernel
def _edges(links: Floats1, index: Unsigned, below: Unsigned, plane: Unsigned) -> Edges:
    """The links of a pixel. below, plane: elements of a row and of a plane."""
    down, right, left = index + plane, index + plane + plane, index + plane + plane + plane
    return Edges(
        links[index], links[index - _NEXT], links[down], links[down - below],
        links[right], links[right - below - _NEXT], links[left], links[left - below + _NEXT],
    )  # fmt: skip


@kernel
def _around(edges: Edges, values: Floats1, index: Unsigned, below: Unsigned) -> Scalar:
    """The sum of the neighbours' values, weighted."""
    return (
        edges.right * values[index + _NEXT]
        + edges.left * values[index - _NEXT]
        + edges.below * values[index + below]
        + edges.above * values[index - below]
        + edges.below_right * values[index + below + _NEXT]
        + edges.above_left * values[index - below - _NEXT]
        + edges.below_left * values[index + below - _NEXT]
        + edges.above_right * values[index - below + _NEXT]
    )


@kernel
def _advance(solution: Floats2, residual: Floats2, direction: Floats2, applied: Floats2, step: Scalar) -> float:
    """Go a step. Returns the square of the residual."""
    x, r, p, q = solution.reshape(-1), residual.reshape(-1), direction.reshape(-1), applied.reshape(-1)
    (rows, width), sums = solution.shape, zeros(solution.shape[1])
    for row in range(BORDER, rows - BORDER):
        for column in range(width):
            index = np.uintp(row * width) + np.uintp(column)
            x[index] += step * p[index]
            rest = r[index] - step * q[index]
            r[index] = rest
            sums[column] += rest * rest
    return _total(sums)


@kernel
def _turn(direction: Floats2, better: Floats2, turn: Scalar) -> None:
    """Turn the direction towards the preconditioned residual."""
    p, z = direction.reshape(-1), better.reshape(-1)
    for index in range(len(p)):
        p[index] = z[index] + turn * p[index]


@kernel
def _add_diagonal(system: System, direction: Floats3, applied: Floats3) -> None:
    """Add what the diagonal and couplings make of a direction."""
    place = 0
    for one in range(len(direction)):
        _add_product(system.diagonal[one], direction[one], applied[one])
        for other in range(one + 1, len(direction) if len(system.coupling) > 0 else 0):
            _add_product(system.coupling[place], direction[other], applied[one])
            _add_product(system.coupling[place], direction[one], applied[other])
            place += 1


@kernel
def _add_product(weight: Floats2, values: Floats2, out: Floats2) -> None:
    w, x, sums = weight.reshape(-1), values.reshape(-1), out.reshape(-1)
    for index in range(len(w)):
        sums[index] += w[index] * x[index]


@kernel
def _inverses(diagonal: Floats3) -> FloatArray:
    """One over the diagonal, 0 where that is 0."""
    result = unset(*diagonal.shape)
    source, out = diagonal.reshape(-1), result.reshape(-1)
    for index in range(len(out)):
        out[index] = _ONE / source[index] if source[index] > _ZERO else _ZERO
    return result


@kernel
def _precondition(residual: Floats2, inverse: Floats2, factor: Doubles2, better: Floats2) -> None:
    """Write the residual over the diagonal to `better`, and add the solution for squares if there are factors."""
    scale, r, z = inverse.reshape(-1), residual.reshape(-1), better.reshape(-1)
    for index in range(len(z)):
        z[index] = scale[index] * r[index]
    if len(factor) > 0:
        _add_squares(residual, factor, better)


@kernel
def _add_squares(residual: Floats2, factor: Doubles2, better: Floats2) -> None:
    rows, width = residual.shape
    across, line, values = (width + _SQUARE - 1) // _SQUARE, zeros(width), np.zeros(len(factor))
    for square in range(len(values) // across):
        line[:] = _ZERO
        for row in range(BORDER + square * _SQUARE, min(BORDER + (square + 1) * _SQUARE, rows)):
            for column in range(width):
                line[column] += residual[row, column]
        for column in range(width):
            values[square * across + column // _SQUARE] += line[column]
    _substitute(factor, across + 1, values)
    for square in range(len(values) // across):
        for column in range(width):
            line[column] = values[square * across + column // _SQUARE]
        for row in range(BORDER + square * _SQUARE, min(BORDER + (square + 1) * _SQUARE, rows - BORDER)):
            for column in range(width):
                better[row, column] += line[column]


@kernel
def _factors(system: System) -> Doubles3:
    """The Cholesky factors of the equations for squares, without couplings: (F, squares, squares), banded."""
    count, rows, width = system.diagonal.shape
    across = (width + _SQUARE - 1) // _SQUARE
    squares = (rows - 2 * BORDER + _SQUARE - 1) // _SQUARE * across
    factors = np.zeros((count, squares, squares))
    for row in range(rows - 2 * BORDER):
        for column in range(width):
            square = row // _SQUARE * across + column // _SQUARE
            for field in range(count):
                factors[field, square, square] += system.diagonal[field, BORDER + row, column]
            for side in range(4):
                link = system.links[side, BORDER + row, column]
                over = 0 if side == 1 else -1 if side == 3 else 1  # columns to the right
                other = (row + (side > 0)) // _SQUARE * across + (column + over) // _SQUARE
                for field in range(count if link > _ZERO else 0):
                    factors[field, max(square, other), min(square, other)] -= 2 * link if other == square else link
    for field in range(count):
        _factorise(factors[field], across + 1)
    return factors


@kernel
def _factorise(factor: Doubles2, band: int) -> None:
    """Replace a banded matrix by its Cholesky factor; rows without an equation get a diagonal of 1."""
    for row in range(len(factor)):
        for column in range(max(row - band, 0), row + 1):
            rest = factor[row, column]
            for before in range(max(row - band, 0), column):
                rest -= factor[row, before] * factor[column, before]
            factor[row, column] = rest / factor[column, column] if column < row else math.sqrt(rest) if rest != 0 else 1


@kernel
def _substitute(factor: Doubles2, band: int, values: Doubles1) -> None:
    """Solve, in place, the system whose banded Cholesky factor this is."""
    for row in range(len(values)):
        rest = values[row]
        for column in range(max(row - band, 0), row):
            rest -= factor[row, column] * values[column]
        values[row] = rest / factor[row, row]
    for row in range(len(values) - 1, -1, -1):
        values[row] /= factor[row, row]
        for column in range(max(row - band, 0), row):
            values[column] -= factor[row, column] * values[row]
