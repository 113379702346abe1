"""Array types, the order of axes, and the border convention.

Axes are (row, column), for pictures (row, column, channel); row 0 is the top. Every stage that
reads beyond the frame sees its mirror image without the edge pixel repeated (d c b | a b c d | c b
a). NumPy's `pad` calls this "reflect" (``BORDER``), SciPy's ndimage "mirror", OpenCV
``BORDER_REFLECT_101``. (SciPy's "reflect" is a different convention.)
"""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

FloatArray = NDArray[np.float32]
DoubleArray = NDArray[np.float64]
CodeArray = NDArray[np.uint16]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
Pair = tuple[int, int]
"""A row and a column, how many of both, or the first and the end of some."""

BORDER: Literal["reflect"] = "reflect"


def mirrored(places: IndexArray, size: int) -> IndexArray:
    """Indices inside an axis of `size` that `places`, inside or outside, show by the convention of
    ``BORDER``.
    """
    turn = max(2 * (size - 1), 1)
    return np.minimum(places % turn, -places % turn)


STRIP = 256
"""Rows of a picture that are processed at a time, so that temporary arrays stay small compared with
the picture.
"""


def unmasked(array: object) -> NDArray[Any]:
    """The argument as an array of NumPy. Raises InputError for one of which values are masked."""
    if np.ma.is_masked(array):
        raise InputError("an array has masked values; fill them, as by `array.filled(0)`")
    return np.asarray(array)


def is_frozen(array: NDArray[Any]) -> bool:
    """Return True if nobody can write to an array, nor to what it is a view of."""
    memory: Any = array
    while isinstance(memory, np.ndarray):
        if memory.flags.writeable:
            return False
        memory = memory.base
    return memory is None or memoryview(memory).readonly


CACHED = 1 << 14
"""Pixels whose planes fit in the processor's cache, for work of many steps."""


def strips(rows: int, height: int = STRIP) -> Iterator[slice]:
    """Slices of at most `height` rows that together cover the rows 0 to `rows`."""
    return (slice(first, min(first + height, rows)) for first in range(0, rows, height))
