"""Planes that fit samples and are smooth except across edges: the minimum of a sum of squares.

Conjugate gradients find it. Where samples are few or uncertain, each one influences hundreds of pixels, which would take as many
iterations. So the preconditioner has two levels (additive Schwarz: Dryja and Widlund 1987): the diagonal, and
the same system for planes that are constant on each of some squares, which is solved directly.
"""

import math

import numpy as np

from .arrays import Doubles1, Doubles2, Doubles3, Floats2, Floats3, Pair, Scalar
from .compile import kernel
from .functions import zeros

Prior = tuple[float, float, float]
"""Smoothness and fading, relative to the precision of a sample, and the difference of luminance, scene units, that is an edge."""
TILE = 128
"""Rows and columns of a tile, which is solved at a time. Chosen for speed."""
_CELL = 8  # pixels: side of the squares; chosen for speed
_ITERATIONS = 1000  # at most; bursts of two to eight frames took 93 or less, in noise of 0 to 0.1
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


def tiles_of(rows: tuple[int, int], width: int) -> int:
    """The number of tiles in some rows of a frame. rows: first and end row; the first is a multiple of `TILE`."""
    return -(-(rows[1] - rows[0]) // TILE) * -(-width // TILE)


@kernel
def link(light: Floats2, prior: Prior, links: Floats3) -> None:
    """How much each pixel is to be like those to the right, below, below right and below left; little across edges."""
    rows, columns = light.shape
    stiff, per_edge = np.float32(prior[0]), np.float32(1 / prior[2] ** 2)
    for row in range(rows):
        for column in range(columns):
            for side in range(4):
                i, j = _beside(row, column, side)
                if i < rows and 0 <= j < columns:
                    step = light[i, j] - light[row, column]
                    links[side, row, column] = (stiff if side < 2 else _HALF * stiff) / (_ONE + step * step * per_edge)


@kernel
def solve(
    normal: Floats3, right_side: Floats3, links: Floats3, fading: Scalar, tolerance: float, solution: Floats3
) -> tuple[float, int]:
    """Solve by conjugate gradients until the residual, in the norm of the preconditioner, is `tolerance` of what it was.

    normal: (P (P + 1) / 2, H, W), the normal equations of the samples at each pixel: upper triangles for P planes.
    right_side: (P, H, W); what is left of it at the end.
    links: (4, H, W), see `link`. fading: how much each plane is to be 0.
    solution: (P, H, W), zeros at first.
    Returns the residual, relative to what it was, and the iterations used. The residual is NaN if a value is not finite.
    """
    parts, rows, columns = right_side.shape
    scale, direction, applied = zeros(parts, rows, columns), zeros(parts, rows, columns), zeros(parts, rows, columns)
    better, degree = zeros(parts, rows, columns), zeros(rows, columns)
    for row in range(rows):
        for column in range(columns):
            for side in range(4):
                if links[side, row, column] > _ZERO:
                    i, j = _beside(row, column, side)
                    degree[row, column] += links[side, row, column]
                    degree[i, j] += links[side, row, column]
    factors = np.zeros((parts, _cells(rows) * _cells(columns), _cells(rows) * _cells(columns)))
    for part in range(parts):
        place = part * parts - part * (part - 1) // 2
        for row in range(rows):
            for column in range(columns):
                scale[part, row, column] = _ONE / (normal[place, row, column] + degree[row, column] + fading)
        _factorise(normal[place], links, fading, factors[part])
    squared = _improve(right_side, scale, factors, better)
    begin, turn, iterations = squared, _ZERO, 0
    while squared > tolerance**2 * begin and iterations < _ITERATIONS:
        iterations += 1
        for part in range(parts):
            for row in range(rows):
                for column in range(columns):
                    direction[part, row, column] = better[part, row, column] + turn * direction[part, row, column]
        _apply(normal, links, degree, fading, direction, applied)
        curvature = 0.0
        for part in range(parts):
            for row in range(rows):
                for column in range(columns):
                    curvature += direction[part, row, column] * applied[part, row, column]
        step = np.float32(squared / curvature)
        for part in range(parts):
            for row in range(rows):
                for column in range(columns):
                    solution[part, row, column] += step * direction[part, row, column]
                    right_side[part, row, column] -= step * applied[part, row, column]
        following = _improve(right_side, scale, factors, better)
        turn, squared = np.float32(following / squared), following
    return 0.0 if begin == 0 else math.sqrt(squared / begin), iterations


@kernel
def _beside(row: int, column: int, side: int) -> Pair:
    """The pixel that a link leads to: to the right, below, below right and below left."""
    return row + (1 if side else 0), column + (1 if side in (0, 2) else -1 if side == 3 else 0)


@kernel
def _cells(size: int) -> int:
    """How many squares there are along a side."""
    return (size + _CELL - 1) // _CELL


@kernel
def _factorise(normal: Floats2, links: Floats3, fading: Scalar, factor: Doubles2) -> None:
    """Write the Cholesky factor of the system for the squares of one plane to `factor`, zeros at first."""
    rows, columns = normal.shape
    along = _cells(columns)
    for row in range(rows):
        for column in range(columns):
            cell = row // _CELL * along + column // _CELL
            factor[cell, cell] += normal[row, column] + fading
            for side in range(4):
                weight = links[side, row, column]
                if weight > _ZERO:
                    i, j = _beside(row, column, side)
                    other = i // _CELL * along + j // _CELL
                    if other != cell:
                        factor[cell, cell] += weight
                        factor[other, other] += weight
                        factor[max(cell, other), min(cell, other)] -= weight
    for cell in range(len(factor)):
        first = max(cell - along - 1, 0)  # a square has nothing to do with earlier ones
        for before in range(first, cell + 1):
            rest = factor[cell, before]
            for each in range(first, before):
                rest -= factor[cell, each] * factor[before, each]
            factor[cell, before] = rest / factor[before, before] if before < cell else math.sqrt(rest)


@kernel
def _improve(residual: Floats3, scale: Floats3, factors: Doubles3, better: Floats3) -> float:
    """Write the residual times the preconditioner to `better`. Returns the product of both."""
    parts, rows, columns = residual.shape
    along, squared = _cells(columns), 0.0
    coarse = np.empty(factors.shape[1])
    for part in range(parts):
        for cell in range(len(coarse)):
            coarse[cell] = 0.0
        for row in range(rows):
            for column in range(columns):
                coarse[row // _CELL * along + column // _CELL] += residual[part, row, column]
        _substitute(factors[part], along + 1, coarse)
        for row in range(rows):
            for column in range(columns):
                whole = np.float32(coarse[row // _CELL * along + column // _CELL])
                better[part, row, column] = scale[part, row, column] * residual[part, row, column] + whole
                squared += residual[part, row, column] * better[part, row, column]
    return squared


@kernel
def _substitute(factor: Doubles2, band: int, values: Doubles1) -> None:
    """Solve, in place, the system whose banded Cholesky factor this is."""
    for row in range(len(values)):
        for column in range(max(row - band, 0), row):
            values[row] -= factor[row, column] * values[column]
        values[row] /= factor[row, row]
    for row in range(len(values) - 1, -1, -1):
        values[row] /= factor[row, row]
        for column in range(max(row - band, 0), row):
            values[column] -= factor[row, column] * values[row]


@kernel
def _apply(normal: Floats3, links: Floats3, degree: Floats2, fading: Scalar, direction: Floats3, applied: Floats3) -> None:
    """Multiply the matrix of the normal equations and of the prior with a direction."""
    parts, rows, columns = direction.shape
    for part in range(parts):
        for row in range(rows):
            for column in range(columns):
                applied[part, row, column] = (degree[row, column] + fading) * direction[part, row, column]
        for row in range(rows):
            for column in range(columns - 1):
                link = links[0, row, column]
                applied[part, row, column] -= link * direction[part, row, column + 1]
            for column in range(1, columns):
                applied[part, row, column] -= links[0, row, column - 1] * direction[part, row, column - 1]
        for row in range(rows - 1):
            for column in range(columns):
                applied[part, row, column] -= links[1, row, column] * direction[part, row + 1, column]
                applied[part, row + 1, column] -= links[1, row, column] * direction[part, row, column]
            for column in range(columns - 1):
                applied[part, row, column] -= links[2, row, column] * direction[part, row + 1, column + 1]
                applied[part, row + 1, column + 1] -= links[2, row, column] * direction[part, row, column]
                applied[part, row, column + 1] -= links[3, row, column + 1] * direction[part, row + 1, column]
                applied[part, row + 1, column] -= links[3, row, column + 1] * direction[part, row, column + 1]
    place = 0
    for part in range(parts):
        for other in range(part, parts):
            for row in range(rows):
                for column in range(columns):
                    applied[part, row, column] += normal[place, row, column] * direction[other, row, column]
                    if other != part:
                        applied[other, row, column] += normal[place, row, column] * direction[part, row, column]
            place += 1
