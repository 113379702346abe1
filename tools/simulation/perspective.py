"""Projective maps of the plane: how a flat chart appears in a picture."""

import numpy as np

from ...shared.arrays import DoubleArray


def rectangle(left: float, top: float, right: float, bottom: float) -> DoubleArray:
    """Return the corners of a rectangle, (4, 2), x and y, clockwise from the top left."""
    return np.array([(left, top), (right, top), (right, bottom), (left, bottom)], float)


def homography(source: DoubleArray, destination: DoubleArray) -> DoubleArray:
    """Return the projective map (3, 3), last entry 1, that takes four points (4, 2) to four others.

    Raises numpy.linalg.LinAlgError if three of the points are on a line.
    """
    (x, y), (u, v) = source.T, destination.T
    one, nil = np.ones_like(x), np.zeros_like(x)
    across = [x, y, one, nil, nil, nil, -u * x, -u * y]
    down = [nil, nil, nil, x, y, one, -v * x, -v * y]
    equations = np.concatenate([np.stack(across, axis=1), np.stack(down, axis=1)])
    return np.append(np.linalg.solve(equations, destination.T.ravel()), 1.0).reshape(3, 3)


def apply_homography(
    matrix: DoubleArray, x: DoubleArray, y: DoubleArray
) -> tuple[DoubleArray, DoubleArray]:
    """Return the points (x, y), arrays of any one shape, after a projective map (3, 3)."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in matrix)
    return u / w, v / w
