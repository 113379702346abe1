"""Initial chromaticity of every pixel: a convex combination of the four blocks around it (section 3.3, Eqs. 10 and 14)."""

from dataclasses import dataclass

import numpy as np

from shared.arrays import FloatArray
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..kernels.mixing import mix
from ..measured import Measured
from ..parts import Look, Part, RowStage
from ..settings import AffinitySettings, PropagationSettings
from ..tiling import core_patches, domain_places, patches_of
from .affinity import solve_affinities

_BYTES, _CHANNEL = 48.0, 28.0  # per pixel (four fields), and per channel of it (the same rows at several stages): measured


@dataclass(eq=False)
class Propagation(RowStage):
    """Spread the chromaticity of the blocks of a frame to its pixels (Eqs. 10-14)."""

    measured: Measured
    affinity: AffinitySettings
    settings: PropagationSettings
    progress: Progress = SILENT

    name = "propagation"
    kernels = "solve_regions", "mix"

    @property
    def look(self) -> Look:
        """No rows around, but whole rows of cores (`tiling`)."""
        grid = self.measured.grid
        return Look(step=core_patches(grid.period)[0] * grid.period, origin=-grid.padding[0][0])

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return (_BYTES + _CHANNEL * channels) * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with a chromaticity that does not depend on the part's.

        Raises ConvergenceError when conjugate gradients do not reach their tolerance.
        """
        luminance, pattern = self.measured.luminance, self.measured.pattern
        fields = solve_affinities(luminance, pattern, self.affinity, rows, self.progress)  # alpha, Eqs. 11-13
        colour = propagate(self.measured.blocks, fields, luminance, pattern, self.settings, rows)  # c, Eqs. 10 and 14
        return Part(rows[0], part.rows(*rows).luminance, colour)


def propagate(
    blocks: FloatArray,
    affinity: FloatArray,
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: PropagationSettings,
    rows: tuple[int, int] | None = None,
) -> FloatArray:
    """c[n] of some rows of the frame, float32 (rows, W, C).

    blocks: chromaticity of every block of the frame, (block rows, block columns, C).
    affinity: the fields that `solve_affinities` returns for the same rows.
    luminance: (H, W), the whole frame.
    rows: first and end; None = all.
    """
    height, width = luminance.shape
    top, bottom = rows or (0, height)
    grid = pattern.grid((height, width))
    (above, _), (left, _) = grid.padding
    fields, first = affinity.reshape(4, *affinity.shape[2:]), patches_of(grid, (top, bottom))[0]
    out = np.empty((bottom - top, width, blocks.shape[-1]), np.float32)
    weighting = settings.softness, settings.likeness
    mix(fields, blocks, luminance, domain_places(grid), first, (top + above - first * grid.period, left), weighting, out)
    return out
