"""Linear DNG: three samples per pixel, to finish in a raw developer.

Code 65535 stands for 1.0 in all files: the brightness does not depend on the picture's brightest spot, and raw developers find
clipped highlights at the white level and make them white.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from shared.display import checked_picture
from shared.dng import PART, EncodedPart, encode_part, join_parts
from shared.dng.tags import LONGEST_SIDE
from shared.errors import InputError
from shared.tiff import write_tiff
from tools.host.ahead import WAITING, ahead

from ..development import CAMERA, Development
from ..samples import display_codes, regrouped
from .format import Format

_MEMORY_OF_PART = 30.0  # bytes per pixel of a part that waits or is compressed


class LinearDng(Format):
    """Linear DNG, with the colours and the white of our own rendering. Only what is compressed is held."""

    name = "dng"
    spaces: ClassVar = {CAMERA: (16,)}
    about = "linear, to finish in a raw developer"
    in_bands = True
    longest_side = LONGEST_SIDE
    memory_per_pixel = 6.0  # of noise; pictures take half of that

    def check(self, development: Development) -> None:
        """See `Format`."""
        channels = development.calibration.channels
        if len(channels) != 3:
            raise InputError(f"dng holds pictures of 3 channels, the sensor has {channels}; use tif, exr or npy")
        _ = development.shown  # raises InputError for unknown colours
        super().check(development)

    def memory(self, shape: tuple[int, int], channels: int, rendering: int, threads: int) -> float:
        """See `Format`."""
        parts = _MEMORY_OF_PART * min(PART * (threads + WAITING + 1), shape[0]) * shape[1]
        return super().memory(shape, channels, rendering, threads) + parts

    def write(self, file: BinaryIO, bands: Iterable[FloatArray], development: Development, *, threads: int, folder: Path) -> None:
        """See `Format`; raw developers turn it."""
        self.encode(file, (checked_picture(band, 3) for band in bands), development, threads)

    def encode(self, file: BinaryIO, bands: Iterable[NDArray[Any]], development: Development, threads: int) -> None:
        """See `Format`. What is saturated, and not restored, gets the white level in every channel."""
        shown, shape = development.shown, development.shape

        def encoded(rgb: FloatArray) -> EncodedPart:
            rgb = shown.whitened(rgb, shown.saturated(rgb))
            return encode_part(rgb, display_codes(rgb, shown, 8), shape)

        parts = list(ahead(encoded, regrouped(bands, PART), threads))
        camera_to_xyz = shown.space.to_xyz @ np.array(shown.matrix)
        main = join_parts(parts, shape, development.noted, camera_to_xyz, shown.white)
        write_tiff(file, main, main.strips)
