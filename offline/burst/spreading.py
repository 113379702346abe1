"""The last stage of a burst: the colour samples of all frames correct the picture, each at its own place."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from shared.arrays import FloatArray
from shared.progress import SILENT, Progress

from ..kernels.spreading import HALO, TILE, TOLERANCE, Samples, spread_samples, tiles_of
from ..measured import Measured
from ..parts import Look, Part, RowStage
from ..solvers import report
from .samples import ColourSamples

# With less, where noise is as strong as light, single precision cannot solve the system. At sigma 0.1 it is 5 times as much.
_LEAST_FADING = 1e-7
_SMOOTHNESS, _FADING = 0.15, 0.01  # chosen: half and twice change drawn scenes by 0.8 and 0.1 dB, some up and others down
_EDGE = 0.08  # difference of luminance that is an edge, a share of the mean luminance; chosen likewise: 0.7 dB


@dataclass(eq=False)
class Spreading(RowStage):
    """Correct the chromaticity around colour samples by what they show.

    samples: of all frames. measured: the reference. progress: hears what the solver did.
    """

    samples: ColourSamples
    measured: Measured
    progress: Progress = SILENT

    name = "samples"
    kernels = ("spread_samples",)

    @property
    def look(self) -> Look:
        """A tile and what surrounds it."""
        return Look(HALO, TILE)

    @cached_property
    def _by_tile(self) -> tuple[Samples, float]:
        return self.samples.by_tile(self.measured.shape, self.measured.gamma)

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows. Raises ConvergenceError when conjugate gradients do not reach their tolerance."""
        gamma, (samples, precision), (height, width) = self.measured.gamma, self._by_tile, self.measured.shape
        prior = _SMOOTHNESS, max(_FADING * precision, _LEAST_FADING), _EDGE * self.samples.level
        shown, tiles = part.rows(*rows), tiles_of(rows, width)
        corrected, residuals, used = np.empty_like(shown.chromaticity), np.empty(tiles), np.empty(tiles, np.intp)
        where = part.luminance, part.chromaticity, part.first, rows, height
        spread_samples(*where, samples, gamma, _basis(len(gamma)), prior, corrected, residuals, used)
        report(self.progress, "samples", used, residuals, TOLERANCE)
        return Part(shown.first, shown.luminance, corrected)


def _basis(channels: int) -> FloatArray:
    """Orthonormal columns that add up to zero, (C, C - 1)."""
    square = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0]
    return np.ascontiguousarray(square[:, 1:], np.float32)
