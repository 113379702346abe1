"""Array types, axis order and the one border convention.

Axes are (row, column) and, for pictures, (row, column, channel); row 0 is the top. Every stage that looks past the frame sees the
mirror image without the edge pixel repeated (d c b | a b c d | c b a): ``BORDER`` for NumPy's `pad`, which SciPy's ndimage calls
"mirror" and OpenCV ``BORDER_REFLECT_101``. (SciPy's "reflect" is another one.)
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]
DoubleArray = NDArray[np.float64]
CodeArray = NDArray[np.uint16]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]

BORDER: Literal["reflect"] = "reflect"

STRIP = 256
"""Rows of a picture worked on at a time, so that temporaries stay small beside it."""


def strips(rows: int) -> Iterator[slice]:
    """Slices of at most STRIP rows that cover `rows` of them."""
    return (slice(first, min(first + STRIP, rows)) for first in range(0, rows, STRIP))
