"""Fields that fit samples and are smooth except across edges of luminance: the minimum of a sum of
squares, chunk by chunk.

Each field x minimises, with w the weights of its samples and b these times what is sampled, s the
smoothness, f the fading, t an edge and l the luminance,

    sum_n (w[n] x[n]^2 - 2 b[n] x[n] + f x[n]^2)
    + sum_nn' s / (1 + ((l[n] - l[n']) / t)^2) (x[n] - x[n'])^2

over neighbours n, n', diagonal ones with half the smoothness.
"""

from typing import NamedTuple

import numpy as np

from ...shared.arrays import FloatArray, Pair
from . import conjugate_gradients as solver
from .arrays import Doubles1, Floats2, Floats3, Frozen2, Ints1
from .compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from .functions import ORIENTATIONS, chunk_at, chunk_count, zeros

SIDE = 128
"""Rows and columns of a chunk, which is solved at a time. Chosen for speed."""
_ITERATIONS = 1000  # at most; bursts of two to eight frames took 200 or less, in noise of 0 to 0.1


class Fit(NamedTuple):
    """Smoothness and fading, relative to the weight of a sample; the difference of luminance, scene
    units, that is an edge; pixels around a chunk that are solved with it; and the tolerance.
    """

    smoothness: float
    fading: float
    edge: float
    halo: int
    tolerance: float


def fitted(
    luminance: FloatArray, weights: FloatArray, products: FloatArray, fit: Fit, span: Pair
) -> FloatArray:
    """Fields of some rows of a band of the picture, float32 (F, rows, W).

    Parameters
    ----------
    luminance : FloatArray
        (rows, W), of the band.
    weights, products : FloatArray
        Samples of F fields, (F, rows, W): weights, 0 where there are none, and these times the
        values.
    span : Pair
        First and end row to solve, where chunks begin at the first.

    Raises
    ------
    ConvergenceError
        When conjugate gradients do not reach their tolerance.
    """
    rows, width = span[1] - span[0], luminance.shape[1]
    chunks = chunk_count((rows, width), (SIDE, SIDE))
    fields = np.empty((len(weights), rows, width), np.float32)
    residuals, used = np.empty(chunks), np.empty(chunks, np.intp)
    solve_linked(luminance, weights, products, fit, span, fields, residuals, used)
    solver.check_convergence("samples", used, residuals, fit.tolerance)
    return fields


@parallel_kernel()
def solve_linked(
    chunks: Chunks,
    luminance: Frozen2,
    weights: Floats3,
    products: Floats3,
    fit: Fit,
    span: Pair,
    fields: Floats3,
    residuals: Doubles1,
    used: Ints1,
) -> None:
    """Solve the chunks of some rows, see `fitted`.

    Parameters
    ----------
    fields : Floats3
        (F, rows, W), written.
    residuals, used : Doubles1, Ints1
        (chunks,), written: relative residual of the worst field, and iterations.
    """
    height, width = luminance.shape
    for chunk in range(chunks[0], chunks[1]):
        top, bottom, left, end = chunk_at(chunk, (span[1] - span[0], width), (SIDE, SIDE))
        first, last, halo = span[0] + top, span[0] + bottom, fit.halo
        rows = slice(max(first - halo, 0), min(last + halo, height))
        columns = slice(max(left - halo, 0), min(end + halo, width))
        given = luminance[rows, columns], weights[:, rows, columns], products[:, rows, columns]
        solution, residuals[chunk], used[chunk] = _solved(*given, fit)
        for row in range(top, bottom):
            lines = solution[: len(fields), solver.BORDER + span[0] + row - rows.start]
            fields[:, row, left:end] = lines[:, left - columns.start : end - columns.start]


@kernel
def _link(luminance: Floats2, fit: Fit, links: Floats3) -> None:
    """Write how much each pixel is to be like those to the right, below, below right and below
    left; little across edges.

    Parameters
    ----------
    links : Floats3
        Planes of `conjugate_gradients`, zeros at first.
    """
    scale, columns = np.float32(1 / fit.edge**2), luminance.shape[1]
    for link in range(len(ORIENTATIONS)):
        down, right = ORIENTATIONS[link]
        weight = np.float32(fit.smoothness if link < 2 else fit.smoothness / 2)
        first, end = max(-right, 0), columns - max(right, 0)
        for row in range(len(luminance) - down):
            here, there = luminance[row, first:end], luminance[row + down, first + right :]
            out = links[link, solver.BORDER + row, first:]
            for column in range(len(here)):
                step = there[column] - here[column]
                out[column] = weight / (ONE + step * step * scale)


@kernel
def _solved(
    luminance: Floats2, weights: Floats3, products: Floats3, fit: Fit
) -> tuple[FloatArray, float, int]:
    """The fields of a chunk, in planes of `conjugate_gradients`, its relative residual and the
    iterations used.
    """
    count, rows, columns = weights.shape
    padded = (count + solver.TOGETHER - 1) // solver.TOGETHER * solver.TOGETHER
    degree, fading = solver.planes(1, (rows, columns))[0], np.float32(fit.fading)
    shape = degree.shape
    links, diagonal, residual = zeros(4, *shape), zeros(padded, *shape), zeros(padded, *shape)
    _link(luminance, fit, links)
    residual[0] = ONE
    solver.linked_sum(links, residual[0], degree)
    residual[0] = ZERO
    for field in range(count):
        for row in range(rows):
            at, sums = solver.BORDER + row, degree[solver.BORDER + row]
            for column in range(columns):
                residual[field, at, column] = products[field, row, column]
                diagonal[field, at, column] = weights[field, row, column] + (sums[column] + fading)
    fields, limits = zeros(padded, *shape), solver.Limits(fit.tolerance, _ITERATIONS)
    left, used = solver.solve(solver.System(links, diagonal), residual, fields, limits, 0.0)
    return fields, left, used
