"""NumPy's own files: the samples, and nothing else."""

from typing import BinaryIO, ClassVar

import numpy as np

from ..development import CAMERA, Development
from .format import Bands, Format


class NumPy(Format):
    """NumPy, version 1.0."""

    name = "npy"
    spaces: ClassVar = {CAMERA: (32,), "srgb": (32,), "display-p3": (32,), "linear-srgb": (32,)}
    memory_per_pixel = 28.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        (pixels,) = bands
        np.save(file, np.ascontiguousarray(pixels), allow_pickle=False)
