"""Functions that several kernels call: exp and 1/sqrt that are fast, mirrored indices, aligned
arrays.
"""

import numpy as np

from ...shared.arrays import FloatArray, Pair
from .arrays import Area, Floats1, Scalar
from .compile import kernel
from .lanes import BYTES, WIDTH, Lanes, root_seed

# x^(-1/2) from its seed y: r = x y^2 is within 0.875 .. 0.993, and y times this cubic in r is off
# by 5.4e-7 at most (minimax fit).
_ROOT = tuple(np.float32(c) for c in (2.2662262, -2.4310766, 1.5637192, -0.39887085))

# e^x = 2^n e^r with n the nearest integer to x / ln 2, and e^r a quintic with e^0 = 1, off by
# 9.2e-8 at most (minimax fit). ln 2 in two terms, the first short enough that n times it is exact.
_PER_LN2, _LN2_HIGH, _LN2_LOW = np.array([1.44269504, 0.693359375, -2.12194440e-4], np.float32)
_EXP = tuple(np.array([1, 0.9999997, 0.4999915, 0.16667636, 0.041897934, 0.008290314], np.float32))
_ROUND = np.float32(1.5 * 2**23)  # added and taken off again, rounds to an integer
LEAST_EXPONENT = np.float32(-87.0)  # e^-87 is about the least normal float32
ORIENTATIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


@kernel
def scaled_reciprocal_root(x: Lanes, scale: Scalar) -> Lanes:
    """A scalar times x^(-1/2), x >= 0; relative error at most 1e-6, and a finite number of 1e18 or
    more at 0.
    """
    y = root_seed(x)
    r = x * y * y
    rest = scale * _ROOT[1] + r * (scale * _ROOT[2] + r * (scale * _ROOT[3]))
    return y * (scale * _ROOT[0] + r * rest)


@kernel
def exponential(x: Scalar) -> Scalar:
    """e^x, float32, for x up to 87; relative error at most 1e-6. Below -87 it stays at e^-87, never
    zero.

    Loops that call it vectorise: with NumPy's they take ten times as long.
    """
    x = max(np.float32(x), LEAST_EXPONENT)
    power = x * _PER_LN2 + _ROUND
    n = power - _ROUND
    r = x - n * _LN2_HIGH - n * _LN2_LOW
    fraction = _EXP[0] + r * (_EXP[1] + r * (_EXP[2] + r * (_EXP[3] + r * (_EXP[4] + r * _EXP[5]))))
    bits = np.float32(fraction).view(np.int32) + (np.float32(power).view(np.int32) << np.int32(23))
    return np.int32(bits).view(np.float32)


@kernel
def mirrored(index: int, size: int) -> int:
    """The pixel 0..size-1 that `index` refers to: the border of `shared.arrays.BORDER`, however far
    outside.
    """
    turn = max(2 * size - 2, 1)
    index = abs(index) % turn
    return index if index < size else turn - index


@kernel
def mirror_ends(line: Floats1, reach: int) -> None:
    """Set the `reach` elements at either end of a line to mirror images of those between."""
    size = len(line) - 2 * reach
    for step in range(1, reach + 1):
        line[reach - step] = line[reach + mirrored(-step, size)]
        line[reach + size - 1 + step] = line[reach + mirrored(size - 1 + step, size)]


def chunk_count(shape: Pair, size: Pair) -> int:
    """Number of chunks that cover a shape; the last of a row and of a column may be smaller.

    Parameters
    ----------
    size : tuple[int, int]
        Height and width of a chunk.
    """
    return -(-shape[0] // size[0]) * -(-shape[1] // size[1])


@kernel
def chunk_at(number: int, shape: Pair, size: Pair) -> Area:
    """First row, end, first column and end of one of the chunks that cover a shape, row by row: as
    many as `chunk_count` says.
    """
    along = (shape[1] + size[1] - 1) // size[1]
    top, left = number // along * size[0], number % along * size[1]
    return top, min(top + size[0], shape[0]), left, min(left + size[1], shape[1])


@kernel
def unset(*shape: int) -> FloatArray:
    """An array of float32, of arbitrary values, aligned to the size of a vector, where reading is
    fastest.
    """
    size = 1
    for length in shape:
        size *= length
    buffer = np.empty(size + WIDTH, np.float32)
    first = -(buffer.ctypes.data // (BYTES // WIDTH)) % WIDTH
    return buffer[first : first + size].reshape(shape)


@kernel
def zeros(*shape: int) -> FloatArray:
    """An array of zeros, otherwise like `unset`."""
    result = unset(*shape)
    result[:] = np.float32(0)
    return result
