"""Initial chromaticity of every pixel: a convex combination of the four blocks around it (section 3.3, Eqs. 10 and 14)."""

import numpy as np

from shared.arrays import FloatArray
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..kernels.mixing import mix
from ..settings import PropagationSettings
from ..tiling import Band, domain_places


def propagate(
    blocks: FloatArray,
    affinity: FloatArray,
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: PropagationSettings,
    band: Band,
    progress: Progress = SILENT,
) -> FloatArray:
    """c[n] of the rows of the frame that the band's patches cover, float32 (rows, W, C).

    blocks: chromaticity of every block of the frame, (block rows, block columns, C).
    affinity: the fields that `solve_affinities` returns for the same band.
    luminance: (H, W), the whole frame.
    """
    progress.part("propagation")
    height, width = luminance.shape
    grid = pattern.grid((height, width))
    (above, _), (left, _) = grid.padding
    fields, first = affinity.reshape(4, *affinity.shape[2:]), band.patches[0]
    top = max(first * grid.period - above, 0)
    bottom = min(first * grid.period + fields.shape[1] - above, height)
    out = np.empty((bottom - top, width, blocks.shape[-1]), np.float32)
    mix(fields, blocks, luminance, domain_places(grid), first, (top + above - first * grid.period, left), settings.softness, out)
    return out
