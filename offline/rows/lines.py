"""Colour of every pixel by the colour lines around it, as far as these explain the blocks (`whole.colour_lines`)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from shared.arrays import FloatArray

from ..blocks import Sites
from ..kernels.lines import lead_to_lines
from ..measured import EVEN, ColourLines
from ..parts import DARK, Part, RowStage


@dataclass(eq=False)
class OnLines(RowStage):
    """Lead chromaticity to the lines, as far as they are believed. sites, lines: of the frame. gamma: (C,), of Eq. 7."""

    sites: Sites
    lines: ColourLines
    gamma: FloatArray

    name = "lines"
    kernels = ("lead_to_lines",)

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * channels * pixels

    @cached_property
    def _planes(self) -> FloatArray:
        share, offset, slope = self.lines.share, self.lines.offset, self.lines.slope
        return np.concatenate([share[None], share * offset, share * slope])

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows."""
        shown, (down, across) = part.rows(*rows), self.sites.middle
        found, period = np.empty(shown.chromaticity.shape, np.float32), self.sites.grid.period
        place, before = (down - shown.first, across), np.ascontiguousarray(shown.chromaticity)
        lead_to_lines(shown.luminance, before, self._planes, place, period, self.gamma, DARK, EVEN, found)
        return replace(shown, chromaticity=found)
