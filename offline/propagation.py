"""Initial chromaticity of every pixel: a convex combination of the four blocks around it (section 3.3, Eqs. 10 and 14)."""

import numpy as np

from shared.arrays import FloatArray
from shared.pattern import CfaPattern

from .kernels.mixing import mix
from .settings import PAPER, PropagationSettings
from .tiling import domain_places


def propagate(
    blocks: FloatArray,
    affinity: FloatArray,
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: PropagationSettings = PAPER.propagation,
) -> FloatArray:
    """c[n], float32 (H, W, C), from block chromaticities (block rows, block columns, C) and the fields of `solve_affinities`."""
    return propagate_patches(blocks, affinity, luminance, pattern, settings, first=0)


def propagate_patches(
    blocks: FloatArray,
    affinity: FloatArray,
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: PropagationSettings,
    first: int,
) -> FloatArray:
    """`propagate` for the rows of patches that the fields are of, of which `first` is the first: float32 (their rows, W, C).

    blocks and luminance: of the whole frame. Rows of the domain outside the frame are left out.
    """
    height, width = luminance.shape
    grid = pattern.grid((height, width))
    (above, _), (left, _) = grid.padding
    rows, columns = domain_places(grid)
    fields = affinity.reshape(4, *affinity.shape[2:])
    top = max(first * grid.period - above, 0)
    bottom = min(first * grid.period + fields.shape[1] - above, height)
    out = np.empty((bottom - top, width, blocks.shape[-1]), np.float32)
    mix(fields, blocks, luminance, rows, columns, first, (top + above - first * grid.period, left), settings.softness, out)
    return out
