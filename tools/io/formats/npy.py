"""NumPy's own files: the samples, and nothing else."""

from collections.abc import Iterable
from typing import Any, BinaryIO, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..development import CAMERA, Development
from .format import Format


class NumPy(Format):
    """NumPy, version 1.0."""

    name = "npy"
    spaces: ClassVar = {CAMERA: (32,), "srgb": (32,), "display-p3": (32,), "linear-srgb": (32,)}
    memory_per_pixel = 28.0

    def encode(self, file: BinaryIO, bands: Iterable[NDArray[Any]], development: Development, threads: int) -> None:
        """See `Format`."""
        (pixels,) = bands
        np.save(file, np.ascontiguousarray(pixels), allow_pickle=False)
