"""The last stage of a burst: the colour samples of all frames correct the picture, each at its own place."""

import numpy as np

from shared.arrays import FloatArray
from shared.mosaic import Mosaic
from shared.progress import Progress

from ..kernels.spreading import HALO, TILE, TOLERANCE, spread_samples, tiles_of
from ..solvers import report
from ..tiling import Part
from .samples import ColourSamples

# With less, where noise is as strong as light, single precision cannot solve the system. At sigma 0.1 it is 5 times as much.
_LEAST_FADING = 1e-7
_SMOOTHNESS, _FADING, _EDGE = 0.15, 0.01, 0.03


class Spreading:
    """How colour samples correct the chromaticity around them.

    mosaic: the reference. progress: hears what the solver did.
    """

    steps = HALO, TILE, 0
    """(reach, step, origin) for `tiling.windows`."""

    def __init__(self, samples: ColourSamples, mosaic: Mosaic, progress: Progress) -> None:
        self._gamma, self._height, self._progress = np.array(mosaic.calibration.gamma, np.float32), mosaic.shape[0], progress
        self._samples, precision = samples.by_tile(mosaic.shape, self._gamma)
        self._prior, self._basis = (_SMOOTHNESS, max(_FADING * precision, _LEAST_FADING), _EDGE), _basis(len(self._gamma))

    def applied(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows of a part of the picture, which reaches `HALO` rows beyond them.

        Raises ConvergenceError when conjugate gradients do not reach their tolerance.
        """
        shown = part.rows(*rows)
        corrected = np.empty_like(shown.chromaticity)
        tiles = tiles_of(rows, part.luminance.shape[1])
        residuals, used = np.empty(tiles), np.empty(tiles, np.intp)
        where = part.luminance, part.chromaticity, part.first, rows, self._height
        spread_samples(*where, self._samples, self._gamma, self._basis, self._prior, corrected, residuals, used)
        report(self._progress, "samples", used, residuals, TOLERANCE)
        return Part(shown.first, shown.luminance, corrected)


def _basis(channels: int) -> FloatArray:
    """Orthonormal columns that add up to zero, (C, C - 1)."""
    square = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0]
    return np.ascontiguousarray(square[:, 1:], np.float32)
