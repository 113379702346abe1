"""Colour of every pixel by the colour lines around it: as luminance says, where one line explains the blocks (`whole.colour_lines`)."""

from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import FloatArray

from ..blocks import Sites
from ..kernels.highlights import interpolate
from ..measured import ColourLines
from ..parts import DARK, Part, RowStage

_LEAST_SHARE = 1e-3  # of a line, below which the picture stays as it is
_LEAST_SUM = 0.5  # of the channels, after none of them is negative
_BYTES = 40.0  # of memory, per pixel and channel: measured


@dataclass(eq=False)
class OnLines(RowStage):
    """Lead chromaticity to the lines, as far as they are believed. sites, lines: of the frame. gamma: (C,)."""

    sites: Sites
    lines: ColourLines
    gamma: FloatArray

    name = "lines"
    kernels = ("interpolate",)

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return _BYTES * channels * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows."""
        shown, lines = part.rows(*rows), self.lines
        share, light = self._spread(lines.share, shown), np.maximum(shown.luminance, DARK)
        found = np.empty_like(shown.chromaticity)
        for channel, (offset, slope) in enumerate(zip(lines.offset, lines.slope, strict=True)):
            found[..., channel] = self._spread(lines.share * offset, shown) / light + self._spread(lines.share * slope, shown)
        # A line is of positive colours: beyond its darkest one it is that of the channels that are left.
        np.maximum(found, 0, out=found)
        total = found.sum(axis=2)
        sure = (share > _LEAST_SHARE) & (total > _LEAST_SUM * share) & (shown.luminance > DARK)
        share = np.where(sure, np.minimum(share, 1), 0)[..., None]
        found /= self.gamma * np.where(sure, total, 1)[..., None]
        return replace(shown, chromaticity=shown.chromaticity + share * (found - shown.chromaticity))

    def _spread(self, values: FloatArray, part: Part) -> FloatArray:
        """Values of the whole blocks, (rows, columns), at the pixels of a part."""
        plane, (down, across) = np.empty_like(part.luminance), self.sites.middle
        interpolate(np.ascontiguousarray(values), (down - part.first, across), self.sites.grid.period, plane)
        return plane
