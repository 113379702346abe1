"""The frame on which speed is measured: the built-in scene as both cameras see it, of any size."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tools.evaluation.rivals.integers import Levels
from tools.scenes.drawn.builtin import builtin_scene

Sample = TypeVar("Sample", bound=np.generic)

_SIGMA, _BITS = 0.01, 12
_STEP = 12  # whole periods and whole Bayer quads fit, so that the pattern continues where pieces meet
_PIECE = 792, 1200  # rows, columns drawn; larger frames repeat them, because drawing takes longer than rendering


@dataclass(frozen=True)
class Frame:
    """One frame in every form that is measured. shape: (rows, columns), multiples of 12."""

    shape: tuple[int, int]

    @classmethod
    def of(cls, megapixels: float) -> "Frame":
        """A frame of about so many, 3 : 2."""
        columns = max(24, round((megapixels * 1.5e6) ** 0.5 / _STEP) * _STEP)
        return cls((max(24, round(megapixels * 1e6 / columns / _STEP) * _STEP), columns))

    @cached_property
    def shot(self) -> Mosaic:
        """The sparse-colour shot as the sensor gives it, in codes."""
        return Mosaic(self._repeated(self._taken.codes), self._taken.pattern, self._taken.calibration)

    @cached_property
    def mosaic(self) -> Mosaic:
        """The sparse-colour shot in scene units."""
        return Mosaic(self._repeated(self._taken.signal), self._taken.pattern, self._taken.calibration)

    @cached_property
    def bayer(self) -> FloatArray:
        """Samples of a Bayer sensor from the same scene with the same noise, scene units."""
        return self._repeated(bayer_mosaic(self._rgb, _SIGMA, np.random.default_rng(0)))

    @cached_property
    def bayer_codes(self) -> NDArray[np.uint16]:
        """The samples `bayer` as 16-bit codes."""
        return Levels.around(self.bayer).encode(self.bayer)

    @cached_property
    def _rgb(self) -> FloatArray:
        rows, columns = (min(size, most) for size, most in zip(self.shape, _PIECE, strict=True))
        return builtin_scene(columns, rows).rgb

    @cached_property
    def _taken(self) -> Mosaic:
        return simulate_additive(self._rgb, CfaPattern.bayer(), SensorCalibration.of_bits(_BITS), _SIGMA, np.random.default_rng(0))

    def _repeated(self, piece: NDArray[Sample]) -> NDArray[Sample]:
        times = tuple(-(-size // drawn) for size, drawn in zip(self.shape, piece.shape, strict=True))
        return np.tile(piece, times)[: self.shape[0], : self.shape[1]]
