"""Mosaics as 16-bit integers, for the rivals that accept only these."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray


@dataclass(frozen=True)
class Levels:
    """A linear encoding: code = black + value * (white - black); 1 scene unit is the code `white`."""

    black: float
    white: float

    @classmethod
    def around(cls, mosaic: FloatArray, headroom: float = 1.02) -> "Levels":
        """Levels between which every sample of a mosaic fits, also below 0 and above 1, so that none is clipped."""
        low, high = min(0.0, float(mosaic.min())), max(1.0, float(mosaic.max()))
        scale = 65535 / ((high - low) * headroom)
        black = -low * scale + (65535 - (high - low) * scale) / 2 * (low < 0)
        return cls(black, black + scale)

    def encode(self, values: FloatArray) -> NDArray[np.uint16]:
        """Codes, uint16, of values in scene units."""
        return np.rint(values * (self.white - self.black) + self.black).clip(0, 65535).astype(np.uint16)

    def decode(self, codes: NDArray[np.uint16]) -> FloatArray:
        """Values in scene units, float32, of codes."""
        return ((codes - np.float32(self.black)) / np.float32(self.white - self.black)).astype(np.float32)
