"""Mosaics as 16-bit integers, for rivals that take nothing else."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray


@dataclass(frozen=True)
class Levels:
    """A linear coding: code = black + value * (white - black), `white` for a value of 1 scene unit."""

    black: float
    white: float

    @classmethod
    def around(cls, mosaic: FloatArray, headroom: float = 1.02) -> "Levels":
        """Levels that hold every sample of a mosaic, below 0 and above 1 too, so that none is clipped."""
        low, high = min(0.0, float(mosaic.min())), max(1.0, float(mosaic.max()))
        scale = 65535 / ((high - low) * headroom)
        black = -low * scale + (65535 - (high - low) * scale) / 2 * (low < 0)
        return cls(black, black + scale)

    def encode(self, values: FloatArray) -> NDArray[np.uint16]:
        """Scene units -> codes, same shape."""
        codes: NDArray[np.uint16] = np.rint(values * (self.white - self.black) + self.black).clip(0, 65535).astype(np.uint16)
        return codes

    def decode(self, codes: NDArray[np.uint16]) -> FloatArray:
        """Codes -> scene units, float32, same shape."""
        values: FloatArray = ((codes - np.float32(self.black)) / np.float32(self.white - self.black)).astype(np.float32)
        return values
