"""How much each pixel belongs to each block: harmonic fields on a graph that luminance edges cut (section 3.3, Eqs. 11-13).

There is one field per parity class of blocks (even or odd block row and column): blocks of the class are pinned to 1, all others
to 0. The four blocks at the corners of a patch belong to four different classes, so the four fields hold every map that the patch
needs. They sum to one at every pixel, so only three are solved (errata: "three maps out of every four").

The fields are those of the whole frame, solved region by region (`kernels.fields`). A region is a core of patches and a halo around
it; cores form a grid that starts with the first patch. What lies beyond the halo changes the core by less than the solver's
tolerance does.
"""

import numpy as np

from shared.arrays import BoolArray, FloatArray, IndexArray
from shared.block_grid import BlockGrid
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..gaussian import TRUNCATE
from ..kernels.fields import CLASSES, solve_regions
from ..kernels.lanes import WIDTH
from ..settings import AffinitySettings
from ..solvers import report
from ..tiling import HALO, core_patches, domain_places, patches_of


def solve_affinities(
    luminance: FloatArray,
    pattern: CfaPattern,
    settings: AffinitySettings,
    rows: tuple[int, int] | None = None,
    progress: Progress = SILENT,
) -> FloatArray:
    """alpha[p, q, n] in 0..1, float32 (2, 2, rows, domain columns): the field of the blocks with row parity p, column parity q.

    The domain is the frame mirrored out to whole patches (`BlockGrid`).

    luminance: (H, W), the whole frame.
    rows: first and end of the frame's rows whose patches are solved; they begin and end where cores do (`tiling.bands`), or where
        the frame does. None = all.
    Raises ConvergenceError when conjugate gradients do not reach the tolerance.
    """
    grid = pattern.grid((luminance.shape[0], luminance.shape[1]))
    period, across = grid.period, grid.patches[1]
    core = core_patches(period)
    filters = derivative_filters(settings.scales)
    places = domain_places(grid, filters[0].shape[1] - 1)
    pins = _pins(pattern, grid, (core[1] + 2 * HALO) * period)
    first, end = patches_of(grid, rows or (0, len(luminance)))
    fields = np.empty((CLASSES, (end - first) * period, across * period), np.float32)
    regions = -(-(end - first) // core[0]) * -(-across // core[1])
    residuals, used = np.empty(regions), np.empty(regions, np.intp)
    patches, limits = (first, end, across), (settings.tolerance, settings.iterations)
    solve_regions(luminance, places, patches, period, core, HALO, pins, filters, limits, fields, residuals, used)
    report(progress, "affinity", used, residuals, settings.tolerance)
    return fields.reshape(2, 2, *fields.shape[1:])


def derivative_filters(scales: tuple[float, ...]) -> tuple[FloatArray, FloatArray, IndexArray]:
    """A Gaussian and its slope at distances 0, 1, ... pixels, one row per scale, and the radius at which each ends.

    scales: standard deviations, pixels. Returns float32 (scales, reach + 1) twice, and (scales,).
    """
    radii = np.array([int(TRUNCATE * scale + 0.5) for scale in scales])
    distance = np.arange(radii.max() + 1)
    smooth = np.array(
        [np.exp(-(distance**2) / (2 * scale**2)) * (distance <= radius) for scale, radius in zip(scales, radii, strict=True)]
    )
    smooth /= smooth[:, :1] + 2 * smooth[:, 1:].sum(axis=1, keepdims=True)
    slope = smooth * distance / np.square(scales)[:, None]
    return smooth.astype(np.float32), slope.astype(np.float32), radii


def _pins(pattern: CfaPattern, grid: BlockGrid, columns: int) -> FloatArray:
    """The pinned values of three classes, and where any pin is, as `solve_regions` takes them."""
    (above, _), (left, _) = grid.padding
    shape = 2 * grid.period, 4 * grid.period + columns + 3 * WIDTH
    pinned = pattern.filter_map(shape, first=(-above, -left)) < len(pattern.channels)
    down, across = ((np.arange(size) + block // 2) // grid.period % 2 for size, block in zip(shape, grid.block_shape, strict=True))
    parity = 2 * down[:, None] + across
    classes: BoolArray = pinned & (parity == np.arange(CLASSES)[:, None, None])
    classes[-1] = pinned
    return classes.astype(np.float32)
