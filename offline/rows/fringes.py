"""Displace the channels of a finished picture as far as they were in the shot (see `whole.fringes`)."""

from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import FloatArray

from ..kernels.fringes import with_fringes
from ..measured import Fringes, Measured
from ..parts import Look, Part, RowStage
from .shading import EvenLight


@dataclass(eq=False)
class Displaced(RowStage):
    """Displace the channels of a picture. gamma: (C,), the weights of Eq. 7."""

    fringes: Fringes
    gamma: FloatArray

    name = "fringes"
    kernels = ("with_fringes",)

    @property
    def look(self) -> Look:
        """The pixels between which a displaced one lies."""
        return Look(self.fringes.reach + 2)

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * channels * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with their fringes."""
        shown, chromaticity = part.rows(*rows), np.ascontiguousarray(part.chromaticity)
        down = self.fringes.seen(0, np.arange(*rows)) - part.first
        across = self.fringes.seen(1, np.arange(chromaticity.shape[1]))
        displaced = np.empty((len(shown.luminance), *chromaticity.shape[1:]), np.float32)
        luminance = np.ascontiguousarray(part.luminance)
        with_fringes(luminance, chromaticity, rows[0] - part.first, down, across, self.gamma, displaced)
        return replace(shown, chromaticity=displaced)


def faults_of_lens(measured: Measured) -> list[RowStage]:
    """The last stages: what a lens did to a frame, and the stages before do not see."""
    fringes, shading = measured.fringes, measured.calibration.shading
    stages: list[RowStage] = [] if fringes is None else [Displaced(fringes, measured.gamma)]
    return stages if shading is None else [*stages, EvenLight(shading, measured.shape)]
