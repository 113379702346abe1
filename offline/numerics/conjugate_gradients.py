"""Conjugate gradients for fields on a graph that joins every pixel to its eight neighbours.

Fields x_f of a region solve, at every pixel n with its neighbours n',

    diagonal_f[n] x_f[n] - sum_n' link[n, n'] x_f[n'] + sum_g coupling_fg[n] x_g[n] = right side_f[n].

Fields without couplings take steps of their own, coupled ones a common step. The preconditioner is the diagonal. Where samples are
few or uncertain, each influences hundreds of pixels, which would take as many iterations; there it has a second level (additive
Schwarz: Dryja and Widlund 1987): the same equations for fields that are constant on each of some squares, solved directly.

A region lies in planes with two rows of zeros above and below. Rows follow each other without a gap: the neighbours of an element
lie at constant distances from it, and those beyond the left and right edge belong to other rows, so that links to them have to be
zero. Links are read once for `TOGETHER` fields; sums run down columns first, which compilers vectorise without changing their order.
Indices are unsigned: a signed one is tested for being negative, which keeps loops from being vectorised.
"""

import math
from typing import NamedTuple

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
_ZERO, _ONE, _NEXT = np.float32(0), np.float32(1), np.uintp(1)


class System(NamedTuple):
    """The equations.

    links: (4, ...), 0 or more, from each pixel to the one on its right, below, below right and below left.
    diagonal: (F, ...), or (1, ...) for all fields; 0 = the pixel keeps its value.
    inverse: one over the diagonal, see `inverses`.
    coupling: (F (F - 1) / 2, ...), of fields 0 and 1, 0 and 2 ... 1 and 2 ...; or none.
    """

    links: Floats3
    diagonal: Floats3
    inverse: Floats3
    coupling: Floats3


class Limits(NamedTuple):
    """Bounds of a solver.

    tolerance: norm of the residual that is small enough, relative to a given one.
    iterations: the most that are allowed.
    """

    tolerance: float
    iterations: int


class Edges(NamedTuple):
    """Weights of the links of a pixel, to each of its neighbours."""

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
def degrees(links: Floats3) -> FloatArray:
    """The sum of each pixel's links, one plane."""
    result = zeros(1, *links.shape[1:])
    flat, out, (_, rows, width) = links.reshape(-1), result.reshape(-1), links.shape
    for row in range(BORDER, rows - BORDER):
        for column in range(width):
            index = np.uintp(row * width) + np.uintp(column)
            edges = _edges(flat, index, np.uintp(width), np.uintp(out.size))
            out[index] = (
                edges.right + edges.left + edges.below + edges.above
                + edges.below_right + edges.above_left + edges.below_left + edges.above_right
            )  # fmt: skip
    return result


@kernel
def inverses(diagonal: Floats3) -> FloatArray:
    """One over the diagonal, 0 where that is 0."""
    result = unset(*diagonal.shape)
    source, out = diagonal.reshape(-1), result.reshape(-1)
    for index in range(len(out)):
        out[index] = _ONE / source[index] if source[index] > _ZERO else _ZERO
    return result


@kernel
def multiply(system: System, values: Floats3, product: Floats3, curvature: Doubles1) -> None:
    """Write the matrix, without couplings, times fields to `product`, where the diagonal is not 0, and each field times that."""
    (count, rows, width), sums = values.shape, zeros(*values.shape[::2])
    below, plane = np.uintp(width), np.uintp(rows * width)
    apart = plane if len(system.diagonal) > 1 else np.uintp(0)
    links = system.links.reshape(-1)
    for group in range(0, count, TOGETHER):
        x, out = values[group : group + TOGETHER].reshape(-1), product[group : group + TOGETHER].reshape(-1)
        diagonal = system.diagonal[group if len(system.diagonal) > 1 else 0 :].reshape(-1)
        for row in range(BORDER, rows - BORDER):
            for column in range(width):
                first = np.uintp(row * width) + np.uintp(column)
                second, third = first + plane, first + plane + plane
                edges = _edges(links, first, below, plane)
                one = diagonal[first] * x[first] - _around(edges, x, first, below)
                two = diagonal[first + apart] * x[second] - _around(edges, x, second, below)
                three = diagonal[first + apart + apart] * x[third] - _around(edges, x, third, below)
                out[first] = one
                out[second] = two
                out[third] = three
            for field in range(group, group + TOGETHER):
                line, source, result = sums[field], values[field, row], product[field, row]
                for column in range(width):
                    line[column] += source[column] * result[column]
    for field in range(count):
        curvature[field] = _total(sums[field])


@kernel
def _edges(links: Floats1, index: int, below: int, plane: int) -> Edges:
    """The links of a pixel. below, plane: elements of a row and of a plane."""
    down, right, left = index + plane, index + plane + plane, index + plane + plane + plane
    return Edges(
        links[index], links[index - _NEXT], links[down], links[down - below],
        links[right], links[right - below - _NEXT], links[left], links[left - below + _NEXT],
    )  # fmt: skip


@kernel
def _around(edges: Edges, values: Floats1, index: int, below: int) -> Scalar:
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
def weighted_product(weight: Floats2, one: Floats2, other: Floats2) -> float:
    """The sum of the products of three planes."""
    sums = zeros(one.shape[1])
    for row in range(BORDER, one.shape[0] - BORDER):
        for column in range(one.shape[1]):
            sums[column] += weight[row, column] * (one[row, column] * other[row, column])
    return _total(sums)


@kernel
def solve(system: System, residual: Floats3, solution: Floats3, limits: Limits, norm: float, squares: bool) -> tuple[float, int]:
    """Improve a solution until its residual is small enough.

    residual: (F, ...), right side minus matrix times `solution`, arbitrary where the diagonal is 0; changed.
    solution: (F, ...), changed.
    norm: squared norm to which the largest residual is relative; 0 = that of the residual at the start.
    squares: whether the preconditioner has two levels. Residuals are measured in its norm.
    Returns the norm of the largest residual, relative to `norm`, and the iterations used. NaN if a value is not finite.
    """
    count, joint = len(residual), len(system.coupling) > 0
    direction, product = zeros(*residual.shape), zeros(*residual.shape)
    factors = _factors(system, count) if squares else np.zeros((count, 0, 0))
    coarse = np.zeros((count, factors.shape[1]))
    steps, squared, before, curvature = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    used = 0
    while True:
        for field in range(count):
            inverse = system.inverse[min(field, len(system.inverse) - 1)]
            step = np.float32(steps[field])
            squared[field] = _advance(solution[field], residual[field], direction[field], product[field], inverse, step)
            squared[field] += _solve_squares(factors[field], residual[field], coarse[field])
        _join(squared, joint)
        norm = norm if norm > 0 else squared.max()
        if used == limits.iterations or not (squared > limits.tolerance**2 * norm).any():
            return math.sqrt(squared.max() / norm) if norm != 0 else 0.0, used
        used += 1
        for field in range(count):
            inverse = system.inverse[min(field, len(system.inverse) - 1)]
            turn = np.float32(squared[field] / before[field] if before[field] > 0 else 0)
            _turn(direction[field], residual[field], inverse, turn)
            _add_squares(coarse[field], direction[field])
        multiply(system, direction, product, curvature)
        curvature[0] += _couple(system.coupling, direction, product)
        _join(curvature, joint)
        for field in range(count):
            steps[field] = squared[field] / curvature[field] if curvature[field] != 0 else 0
            before[field] = squared[field]


@kernel
def _join(products: Doubles1, joint: bool) -> None:
    """Replace the products of coupled fields by their sum."""
    if joint:
        products[:] = products.sum()


@kernel
def _total(sums: Floats1) -> float:
    """The sum of a line, always in the same order."""
    total = 0.0
    for value in sums:
        total += value
    return total


@kernel
def _advance(solution: Floats2, residual: Floats2, direction: Floats2, product: Floats2, inverse: Floats2, step: Scalar) -> float:
    """Go a step. Returns the squared norm of the residual."""
    rows, width = solution.shape
    x, r, p, q, scale = solution.reshape(-1), residual.reshape(-1), direction.reshape(-1), product.reshape(-1), inverse.reshape(-1)
    sums = zeros(width)
    for row in range(BORDER, rows - BORDER):
        for column in range(width):
            index = np.uintp(row * width) + np.uintp(column)
            x[index] += step * p[index]
            rest = r[index] - step * q[index]
            r[index] = rest
            sums[column] += scale[index] * (rest * rest)
    return _total(sums)


@kernel
def _turn(direction: Floats2, residual: Floats2, inverse: Floats2, turn: Scalar) -> None:
    """Turn the direction towards the residual."""
    p, r, scale = direction.reshape(-1), residual.reshape(-1), inverse.reshape(-1)
    for index in range(len(p)):
        p[index] = scale[index] * r[index] + turn * p[index]


@kernel
def _couple(coupling: Floats3, direction: Floats3, product: Floats3) -> float:
    """Add the couplings of fields to the products. Returns the direction times that."""
    place, sums = 0, zeros(direction.shape[2])
    for one in range(len(direction) if len(coupling) > 0 else 0):
        for other in range(one + 1, len(direction)):
            for row in range(BORDER, product.shape[1] - BORDER):
                for column in range(product.shape[2]):
                    change = coupling[place, row, column] * direction[other, row, column]
                    product[one, row, column] += change
                    product[other, row, column] += coupling[place, row, column] * direction[one, row, column]
                    sums[column] += direction[one, row, column] * change
            place += 1
    return 2 * _total(sums)


@kernel
def _factors(system: System, count: int) -> Doubles3:
    """The Cholesky factors of the equations for squares, without couplings: (F, squares, squares), banded."""
    _, rows, width = system.links.shape
    across = (width + _SQUARE - 1) // _SQUARE
    squares = (rows - 2 * BORDER + _SQUARE - 1) // _SQUARE * across
    factors = np.zeros((count, squares, squares))
    for field in range(count):
        factor, diagonal = factors[field], system.diagonal[min(field, len(system.diagonal) - 1)]
        for row in range(rows - 2 * BORDER):
            for column in range(width):
                square = row // _SQUARE * across + column // _SQUARE
                factor[square, square] += diagonal[BORDER + row, column]
                for side in range(4):
                    link = system.links[side, BORDER + row, column]
                    if link > _ZERO:
                        other = (row + (side > 0)) // _SQUARE * across + (column + (1, 0, 1, -1)[side]) // _SQUARE
                        factor[max(square, other), min(square, other)] -= 2 * link if other == square else link
        _factorise(factor, across + 1)
    return factors


@kernel
def _factorise(factor: Doubles2, band: int) -> None:
    """Replace a banded matrix by its Cholesky factor, with one for squares without equations."""
    for row in range(len(factor)):
        for column in range(max(row - band, 0), row + 1):
            rest = factor[row, column]
            for before in range(max(row - band, 0), column):
                rest -= factor[row, before] * factor[column, before]
            factor[row, column] = rest / factor[column, column] if column < row else math.sqrt(rest) if rest > 0 else 1


@kernel
def _solve_squares(factor: Doubles2, residual: Floats2, values: Doubles1) -> float:
    """Write the solution for the residuals of squares to `values`. Returns the product of both."""
    if len(values) == 0:
        return 0.0
    rows, width = residual.shape
    across = (width + _SQUARE - 1) // _SQUARE
    sums, line = np.zeros(len(values)), zeros(width)
    for square in range(len(values) // across):
        line[:] = _ZERO
        for row in range(BORDER + square * _SQUARE, min(BORDER + (square + 1) * _SQUARE, rows)):
            for column in range(width):
                line[column] += residual[row, column]
        for column in range(width):
            sums[square * across + column // _SQUARE] += line[column]
    for row in range(len(values)):
        rest = sums[row]
        for column in range(max(row - across - 1, 0), row):
            rest -= factor[row, column] * values[column]
        values[row] = rest / factor[row, row]
    for row in range(len(values) - 1, -1, -1):
        values[row] /= factor[row, row]
        for column in range(max(row - across - 1, 0), row):
            values[column] -= factor[row, column] * values[row]
    return (sums * values).sum()


@kernel
def _add_squares(values: Doubles1, direction: Floats2) -> None:
    """Add the values of squares to a direction."""
    rows, width = direction.shape
    across, line = (width + _SQUARE - 1) // _SQUARE, zeros(width)
    for square in range(len(values) // across):
        for column in range(width):
            line[column] = values[square * across + column // _SQUARE]
        for row in range(BORDER + square * _SQUARE, min(BORDER + (square + 1) * _SQUARE, rows - BORDER)):
            for column in range(width):
                direction[row, column] += line[column]
