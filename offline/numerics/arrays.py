"""Types of the arguments of kernels: NumPy's for type checkers, and the number of axes, for which
Numba compiles.

A digit is the number of axes. Arrays are contiguous, except where a callee of kernels is given a
section of one.
"""

from typing import Annotated, Any, TypeAlias

import numpy as np
from numba import types

from ...shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray, IndexArray

Scalar: TypeAlias = float | np.floating[Any]
Single = Annotated[Scalar, types.float32]
Floats1 = Annotated[FloatArray, types.float32[::1]]
Floats2 = Annotated[FloatArray, types.float32[:, ::1]]
Floats3 = Annotated[FloatArray, types.float32[:, :, ::1]]
Floats4 = Annotated[FloatArray, types.float32[:, :, :, ::1]]
Frozen2 = Annotated[FloatArray, Floats2.__metadata__[0].copy(readonly=True)]
"""Float32 that a kernel does not write: it may be given an array that must not be written."""
Doubles1 = Annotated[DoubleArray, types.float64[::1]]
Doubles2 = Annotated[DoubleArray, types.float64[:, ::1]]
Doubles3 = Annotated[DoubleArray, types.float64[:, :, ::1]]
Ints1 = Annotated[IndexArray, types.intp[::1]]
Ints2 = Annotated[IndexArray, types.intp[:, ::1]]
Bools1 = Annotated[BoolArray, types.boolean[::1]]
Bools2 = Annotated[BoolArray, types.boolean[:, ::1]]
Bytes3 = Annotated[ByteArray, types.uint8[:, :, ::1]]

Area = tuple[int, int, int, int]
"""First and end row, first and end column."""
