"""How far each pixel belongs to each block: harmonic fields on a graph that luminance edges cut (section 3.3, Eqs. 11-13).

One field per parity class of blocks (even or odd block row and column): blocks of the class are pinned to 1, all others to 0. The
four blocks at the corners of a patch are of four classes, so the four fields hold every map the patch needs; they sum to one at
every pixel, and so only three of them are solved (errata: "three maps out of every four").

The fields are those of the whole frame, found region by region (`kernels.fields`): a core of patches, of which the regions are a
grid that starts with the patches' own, and a halo around it, whose far end is felt in the core by less than the solver's tolerance
leaves.
"""

import numpy as np

from shared.arrays import BoolArray, FloatArray, IndexArray
from shared.errors import ConvergenceError
from shared.pattern import BlockGrid, CfaPattern
from shared.progress import SILENT, Progress

from .kernels.compile import threads
from .kernels.fields import solve_regions
from .kernels.lanes import WIDTH
from .settings import AffinitySettings
from .tiling import domain_places

# Patches. Fields are off by at most 0.007, by 1e-4 rms (photographs): a tenth of what a residual of 1e-3 leaves in them.
HALO = 2
_REGION, _LEAST_CORE = 144, 8  # pixels of a region with its halo, and patches of a core: what a processor's cache holds
_TRUNCATE = 4  # standard deviations at which the filters end
_CLASSES = 4


def solve_affinities(
    luminance: FloatArray, pattern: CfaPattern, settings: AffinitySettings, progress: Progress = SILENT
) -> FloatArray:
    """alpha[p, q, n] in 0..1, float32 (2, 2, domain rows, domain columns): the field of the blocks of grid row parity p, column q.

    The domain is the frame mirrored out to whole patches (`BlockGrid`). Raises ConvergenceError when conjugate gradients do not
    reach the tolerance.
    """
    grid = pattern.grid((luminance.shape[0], luminance.shape[1]))
    down, _ = grid.patches
    core = core_patches(grid.period)
    progress.stage("affinity", -(-down // core))
    fields = solve_patches(luminance, pattern, settings, (0, down))
    progress.advance(-(-down // core))
    return fields


def core_patches(period: int) -> int:
    """Rows and columns of patches of a region's core."""
    return max(_LEAST_CORE, _REGION // period - 2 * HALO)


def solve_patches(luminance: FloatArray, pattern: CfaPattern, settings: AffinitySettings, patches: tuple[int, int]) -> FloatArray:
    """`solve_affinities` for the rows of patches patches[0] up to patches[1], which begin and end where cores or the domain do."""
    grid = pattern.grid((luminance.shape[0], luminance.shape[1]))
    period, across = grid.period, grid.patches[1]
    core = core_patches(period)
    filters = derivative_filters(settings.scales)
    rows, columns = domain_places(grid, filters[0].shape[1] - 1)
    first, end = patches
    fields = np.empty((_CLASSES, (end - first) * period, across * period), np.float32)
    reached = np.empty((-(-(end - first) // core), -(-across // core)))
    solve_regions(
        luminance,
        rows,
        columns,
        (first, end, across),
        period,
        core,
        HALO,
        _pins(pattern, grid, (core + 2 * HALO) * period),
        filters,
        settings.tolerance,
        settings.iterations,
        threads(),
        fields,
        reached.reshape(-1),
    )
    if reached.max() > settings.tolerance:
        raise ConvergenceError(
            f"affinity: conjugate gradients stopped at a relative residual of {reached.max():.1e} after {settings.iterations} "
            f"iterations, short of {settings.tolerance:.1e}"
        )
    return fields.reshape(2, 2, *fields.shape[1:])


def derivative_filters(scales: tuple[float, ...]) -> tuple[FloatArray, FloatArray, IndexArray]:
    """A Gaussian and its slope at distances 0, 1, ... pixels for each scale, float32 (scales, reach + 1), and where each ends."""
    radii = np.array([int(_TRUNCATE * scale + 0.5) for scale in scales])
    distance = np.arange(radii.max() + 1)
    smooth = np.array(
        [np.exp(-(distance**2) / (2 * scale**2)) * (distance <= radius) for scale, radius in zip(scales, radii, strict=True)]
    )
    smooth /= smooth[:, :1] + 2 * smooth[:, 1:].sum(axis=1, keepdims=True)
    slope = smooth * distance / np.square(scales)[:, None]
    return smooth.astype(np.float32), slope.astype(np.float32), radii


def _pins(pattern: CfaPattern, grid: BlockGrid, columns: int) -> FloatArray:
    """The pinned values of three classes and where any pin is, as `solve_regions` wants them: two periods both ways, repeated."""
    (above, _), (left, _) = grid.padding
    shape = 2 * grid.period, 4 * grid.period + columns + 3 * WIDTH
    pinned = pattern.filter_map(shape, first=(-above, -left)) < len(pattern.channels)
    down, across = ((np.arange(size) + block // 2) // grid.period % 2 for size, block in zip(shape, grid.block_shape, strict=True))
    parity = 2 * down[:, None] + across
    classes: BoolArray = pinned & (parity == np.arange(_CLASSES)[:, None, None])
    classes[-1] = pinned
    return classes.astype(np.float32)
