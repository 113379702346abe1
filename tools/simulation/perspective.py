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
    return np.append(np.linalg.solve(*_equations(source, destination)), 1.0).reshape(3, 3)


def fit_homography(source: DoubleArray, destination: DoubleArray) -> DoubleArray | None:
    """Return the projective map (3, 3) that takes points (N, 2) to others, by linear least squares; None if it is ambiguous."""
    shift, scale = destination.mean(axis=0), max(float(destination.std()), 1e-9)
    solved, _, rank, _ = np.linalg.lstsq(*_equations(source, (destination - shift) / scale), rcond=None)
    if rank < solved.size:
        return None
    back = np.array([[scale, 0, shift[0]], [0, scale, shift[1]], [0, 0, 1]])
    return back @ np.append(solved, 1.0).reshape(3, 3)


def apply_homography(matrix: DoubleArray, x: DoubleArray, y: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Return the points (x, y), arrays of any one shape, after a projective map (3, 3)."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in matrix)
    return u / w, v / w


def _equations(source: DoubleArray, destination: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Return the linear equations for the first eight entries of a projective map: (2 N, 8) and (2 N,)."""
    (x, y), (u, v) = source.T, destination.T
    one, nil = np.ones_like(x), np.zeros_like(x)
    across, down = [x, y, one, nil, nil, nil, -u * x, -u * y], [nil, nil, nil, x, y, one, -v * x, -v * y]
    return np.concatenate([np.stack(across, axis=1), np.stack(down, axis=1)]), destination.T.ravel()
