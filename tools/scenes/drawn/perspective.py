"""Projective maps of the plane: how a flat chart lies in a picture."""

import numpy as np

from shared.arrays import DoubleArray


def homography(source: DoubleArray, destination: DoubleArray) -> DoubleArray:
    """The projective map (3, 3) that takes four points (4, 2) to four others; last entry 1."""
    rows = []
    for (x, y), (u, v) in zip(source.tolist(), destination.tolist(), strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    solved = np.linalg.solve(np.array(rows), destination.ravel())
    return np.append(solved, 1.0).reshape(3, 3)


def apply_homography(matrix: DoubleArray, x: DoubleArray, y: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """(x, y) through a projective map."""
    below = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    return (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / below, (
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]
    ) / below
