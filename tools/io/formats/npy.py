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
        pixels = np.ascontiguousarray(pixels)
        # `np.save` would not say why a file cannot be written
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(pixels))
        file.write(pixels.data)
