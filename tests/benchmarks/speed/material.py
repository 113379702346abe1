"""The frames on which speed is measured: the built-in scene as both cameras see it, of any size."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared import CfaPattern, Mosaic, SensorCalibration, write_dng
from shared.arrays import FloatArray
from shared.errors import InputError, OutputError
from shared.sensor import simulate_additive
from tools.evaluation.rivals.bayer import bayer_mosaic
from tools.evaluation.rivals.integers import Levels
from tools.evaluation.rivals.libraw import encode_bayer_dng
from tools.scenes.drawn.builtin import builtin_scene

Sample = TypeVar("Sample", bound=np.generic)

SIGMA, BITS = 0.01, 12
_STEP = 12  # whole periods and whole Bayer quads fit, so that the pattern continues where pieces meet
_ASPECT = 1.5
_PIECE = 792, 1200  # rows, columns drawn; larger frames repeat them, because drawing takes longer than rendering
_LEAST, MOST = 24 * 24 / 1e6, 134.0


def frame_shape(megapixels: float) -> tuple[int, int]:
    """(rows, columns) of about this many pixels, 3 : 2, multiples of 12. Raises InputError for too few or too many."""
    if not _LEAST <= megapixels <= MOST:
        raise InputError(f"--megapixels is {megapixels:g}, expected {_LEAST:.4f} to {MOST:g}")
    columns = max(24, round((megapixels * 1e6 * _ASPECT) ** 0.5 / _STEP) * _STEP)
    return max(24, round(megapixels * 1e6 / columns / _STEP) * _STEP), columns


@dataclass(frozen=True)
class Material:
    """One frame in every form that is measured. shape: (rows, columns), multiples of 12."""

    shape: tuple[int, int]

    @property
    def pixels(self) -> int:
        """Number of pixels of the sensor."""
        return self.shape[0] * self.shape[1]

    @cached_property
    def shot(self) -> Mosaic:
        """The sparse-colour shot as the sensor gives it, in codes."""
        return Mosaic(self._repeated(self._taken.codes), self._taken.pattern, self._taken.calibration)

    @cached_property
    def mosaic(self) -> Mosaic:
        """The sparse-colour shot in scene units."""
        return Mosaic(self._repeated(self._taken.signal), self._taken.pattern, self._taken.calibration)

    @contextmanager
    def saved_shot(self) -> Iterator[Path]:
        """The shot as a DNG in a temporary folder. Raises OutputError when there is no room for it."""
        try:
            with TemporaryDirectory(prefix="panchroma-bench-") as folder:
                path = Path(folder) / "shot.dng"
                write_dng(path, self.shot, np.zeros((8, 8, 3), np.uint8))
                yield path
        except OSError as error:
            raise OutputError(f"no room for temporary files ({error.strerror or error}); set TMPDIR to another folder") from error

    @cached_property
    def bayer(self) -> FloatArray:
        """Samples of a Bayer sensor from the same scene with the same noise, scene units."""
        return self._repeated(bayer_mosaic(self._rgb, SIGMA, np.random.default_rng(0)))

    @cached_property
    def bayer_codes(self) -> NDArray[np.uint16]:
        """The samples `bayer` as 16-bit codes."""
        return Levels.around(self.bayer).encode(self.bayer)

    @cached_property
    def bayer_dng(self) -> bytes:
        """The samples `bayer` as an uncompressed DNG."""
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
