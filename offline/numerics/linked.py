"""Fields that fit samples and are smooth except across edges of luminance: the minimum of a sum of squares, tile by tile.

With w_fg the normal equations of the samples, s the smoothness, f the fading and t an edge, the fields x minimise

    sum_n (sum_fg w_fg[n] x_f[n] x_g[n] - 2 sum_f b_f[n] x_f[n] + f sum_f x_f[n]^2)
    + sum_nn' s / (1 + ((l[n] - l[n']) / t)^2) sum_f (x_f[n] - x_f[n'])^2

over neighbours n, n', diagonal ones with half the smoothness; l is luminance, b the right sides.
"""

import numpy as np

from .arrays import Floats1, Floats2, Floats3, Scalar
from .compile import kernel
from .conjugate_gradients import BORDER, TOGETHER, Limits, System, linked_sum, planes
from .conjugate_gradients import solve as solve_system
from .functions import zeros

Prior = tuple[float, float, float]
"""Smoothness and fading, relative to the precision of a sample, and the difference of luminance, scene units, that is an edge."""
TILE = 128
"""Rows and columns of a tile, which is solved at a time. Chosen for speed."""
_ITERATIONS = 1000  # at most; bursts of two to eight frames took 93 or less, in noise of 0 to 0.1
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


def tiles_of(rows: tuple[int, int], width: int) -> int:
    """The number of tiles in some rows of a frame. rows: first and end row; the first is a multiple of `TILE`."""
    return -(-(rows[1] - rows[0]) // TILE) * -(-width // TILE)


@kernel
def link(light: Floats2, prior: Prior, links: Floats3) -> None:
    """Write how much each pixel is to be like those to the right, below, below right and below left; little across edges.

    links: (4, H, W), zeros at first.
    """
    smoothness, per_edge, rows = np.float32(prior[0]), np.float32(1 / prior[2] ** 2), len(light)
    for row in range(rows):
        _link_row(light[row, :-1], light[row, 1:], smoothness, per_edge, links[0, row])
        if row + 1 < rows:
            _link_row(light[row], light[row + 1], smoothness, per_edge, links[1, row])
            _link_row(light[row, :-1], light[row + 1, 1:], _HALF * smoothness, per_edge, links[2, row])
            _link_row(light[row, 1:], light[row + 1, :-1], _HALF * smoothness, per_edge, links[3, row, 1:])


@kernel
def _link_row(here: Floats1, there: Floats1, weight: Scalar, per_edge: Scalar, links: Floats1) -> None:
    for column in range(len(here)):
        step = there[column] - here[column]
        links[column] = weight / (_ONE + step * step * per_edge)


@kernel
def solve(
    normal: Floats3, right_side: Floats3, links: Floats3, fading: Scalar, tolerance: float, solution: Floats3
) -> tuple[float, int]:
    """Solve by conjugate gradients until the residual, in the norm of the preconditioner, is `tolerance` of what it was.

    normal: (P (P + 1) / 2, H, W), normal equations of the samples at each pixel, upper triangles for P fields; or their diagonals
        alone, (P, H, W).
    right_side: (P, H, W). links: (4, H, W), see `link`. fading: how much each field is to be 0.
    solution: (P, H, W), written.
    Returns the residual, relative to what it was, and the iterations used. The residual is NaN if a value is not finite.
    """
    (parts, rows, columns), coupled = right_side.shape, len(normal) > len(right_side)
    count = (parts + TOGETHER - 1) // TOGETHER * TOGETHER
    graph, degree = planes(4, (rows, columns)), planes(1, (rows, columns))[0]
    for side in range(4):
        _place(links[side], graph[side])
    shape = degree.shape
    diagonal, residual, unknowns = zeros(count, *shape), zeros(count, *shape), zeros(count, *shape)
    residual[0] = _ONE
    linked_sum(graph, residual[0], degree)
    residual[0] = _ZERO
    coupling = zeros(count * (count - 1) // 2 if coupled else 0, *shape)
    place = pair = 0
    for part in range(count):
        if part < parts:
            _place(right_side[part], residual[part])
            _place(normal[place], diagonal[part])
            place += 1
        for row in range(BORDER, BORDER + rows):
            line, sums = diagonal[part, row], degree[row]
            for column in range(columns):
                line[column] += sums[column] + fading
        for other in range(part + 1, count if coupled else 0):
            if other < parts:
                _place(normal[place], coupling[pair])
                place += 1
            pair += 1
    result = solve_system(System(graph, diagonal, coupling), residual, unknowns, Limits(tolerance, _ITERATIONS), 0.0)
    for part in range(parts):
        for row in range(rows):
            line, source = solution[part, row], unknowns[part, BORDER + row]
            for column in range(columns):
                line[column] = source[column]
    return result


@kernel
def _place(source: Floats2, plane: Floats2) -> None:
    """Copy a region into a plane."""
    for row in range(len(source)):
        line, values = plane[BORDER + row], source[row]
        for column in range(len(values)):
            line[column] = values[column]
