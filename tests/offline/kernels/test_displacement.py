"""Sums over tiles against the same sums in NumPy, on planes that bicubic interpolation reproduces."""

import numpy as np

from offline.kernels.displacement import SUMS, displacement_sums
from shared.arrays import DoubleArray

FLOAT32 = 1e-4  # relative to the largest sum of a kind: rows of float32 squares and products
HEIGHT, WIDTH = 40, 50


def quadratic(y: DoubleArray, x: DoubleArray) -> DoubleArray:
    return 1 + 0.02 * y - 0.03 * x + 0.001 * y * x + 0.0007 * y**2


def test_sums_are_those_of_numpy() -> None:
    y, x = np.indices((HEIGHT, WIDTH)).astype(np.float64)
    reference, frame = np.cos(y / 5 + x / 7).astype(np.float32), quadratic(y, x).astype(np.float32)
    reference[5, 5] = np.nan
    rows, columns = np.array([0, 17, 40]), np.array([0, 30, 31, 50])
    turn, starts, gain = (0.99, -0.1, 0.1, 0.99), np.random.default_rng(0).uniform(-2, 2, (2, 3, 2)), 1.7
    sums = np.empty((2, 3, SUMS))
    displacement_sums(reference, frame, rows, columns, turn, starts, gain, sums)

    tile = np.searchsorted(rows, np.arange(HEIGHT), "right")[:, None] - 1, np.searchsorted(columns, np.arange(WIDTH), "right") - 1
    start = starts[tile]
    to_y, to_x = turn[0] * y + turn[1] * x + start[..., 0], turn[2] * y + turn[3] * x + start[..., 1]
    gy, gx = np.gradient(reference)
    r, f = reference.astype(np.float64), quadratic(to_y, to_x) / gain
    e = f - r
    counts = (to_y >= 1) & (to_y < HEIGHT - 2) & (to_x >= 1) & (to_x < WIDTH - 2) & np.isfinite(e + gy + gx)
    counts[[0, -1]] = counts[:, [0, -1]] = False
    kinds = np.stack([np.ones_like(e), gy, gx, gy * gy, gy * gx, gx * gx, e, gy * e, gx * e, e * e, r, f, r * r, r * f], axis=-1)
    expected = np.zeros_like(sums)
    np.add.at(expected, tuple(np.broadcast_arrays(*tile)), np.where(counts[..., None], kinds, 0))
    np.testing.assert_allclose(sums / np.abs(expected).max(axis=(0, 1)), expected / np.abs(expected).max(axis=(0, 1)), atol=FLOAT32)
