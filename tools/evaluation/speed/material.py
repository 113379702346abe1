"""What is rendered when speed is measured: the built-in scene as both cameras see it, of any size."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.sensor import simulate_additive
from tools.scenes.drawn.builtin import builtin_scene

from ..rivals.bayer import bayer_mosaic
from ..rivals.integers import Levels
from ..rivals.libraw import encode_bayer_dng

Sample = TypeVar("Sample", bound=np.generic)

SIGMA, BITS = 0.01, 12
_STEP = 12  # whole periods and whole Bayer quads fit, so that the pattern goes on where pieces meet
_ASPECT = 1.5
_PIECE = 792, 1200  # rows, columns drawn; larger frames repeat them, for drawing takes longer than rendering
_LEAST, MOST = 24 * 24 / 1e6, 134.0


def frame_shape(megapixels: float) -> tuple[int, int]:
    """(rows, columns) of about so many pixels, 3 : 2, multiples of 12. Raises InputError when it is too little or too much."""
    if not _LEAST <= megapixels <= MOST:
        raise InputError(f"--megapixels is {megapixels:g}, expected {_LEAST:.4f} to {MOST:g}")
    columns = max(24, round((megapixels * 1e6 * _ASPECT) ** 0.5 / _STEP) * _STEP)
    return max(24, round(megapixels * 1e6 / columns / _STEP) * _STEP), columns


@dataclass(frozen=True)
class Material:
    """One frame, (rows, columns), multiples of 12, in every form in which something takes it."""

    shape: tuple[int, int]

    @property
    def pixels(self) -> int:
        """Of the sensor."""
        return self.shape[0] * self.shape[1]

    @cached_property
    def shot(self) -> Mosaic:
        """As the sensor gives it: codes."""
        taken = self._taken
        return Mosaic(self._repeated(taken.codes), taken.pattern, taken.calibration)

    @cached_property
    def mosaic(self) -> Mosaic:
        """In scene units."""
        taken = self._taken
        return Mosaic(self._repeated(taken.signal), taken.pattern, taken.calibration)

    @cached_property
    def bayer(self) -> FloatArray:
        """The same scene under the same noise by a Bayer sensor, scene units."""
        return self._repeated(bayer_mosaic(self._rgb, SIGMA, np.random.default_rng(0)))

    @cached_property
    def bayer_codes(self) -> NDArray[np.uint16]:
        """The same with 16 bits."""
        return Levels.around(self.bayer).encode(self.bayer)

    @cached_property
    def bayer_dng(self) -> bytes:
        """The same as a file, uncompressed."""
        return encode_bayer_dng(self.bayer_codes)

    @cached_property
    def _rgb(self) -> FloatArray:
        rows, columns = (min(size, most) for size, most in zip(self.shape, _PIECE, strict=True))
        return builtin_scene(columns, rows).rgb

    @cached_property
    def _taken(self) -> Mosaic:
        return simulate_additive(self._rgb, CfaPattern.bayer(), SensorCalibration.of_bits(BITS), SIGMA, np.random.default_rng(0))

    def _repeated(self, piece: NDArray[Sample]) -> NDArray[Sample]:
        times = tuple(-(-size // drawn) for size, drawn in zip(self.shape, piece.shape, strict=True))
        return np.tile(piece, times)[: self.shape[0], : self.shape[1]]
