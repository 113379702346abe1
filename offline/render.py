"""The full-quality render on one page: mosaic -> luminance -> chromaticity -> affinity -> propagation -> refinement -> RGB.

Mending, restoring, denoising and pooling are not in the paper: the preset BEST adds them for defective samples, for too much light
and for too little.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from shared.arrays import ByteArray, FloatArray
from shared.calibration import NoiseModel, SensorCalibration
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from .aberration import without_aberration
from .blocks import BlockSums
from .cleaned import Cleaned, unclipped_blocks
from .kernels.mixing import colour
from .rows.affinity import solve_affinities
from .rows.learned import learner_for
from .rows.pinning import Pinning
from .rows.propagation import propagate
from .rows.refinement import noise_level, reach, refine
from .settings import BEST, LearnedSettings, RenderSettings, SiteSettings
from .sites import BlockSamples, block_samples, correct_sites, settle_luminance
from .solvers import Solved, SolverLog
from .tiling import Part, bands, windows
from .units import check_finite, in_scene_units, own_unit, scaled
from .whole.chromaticity import estimate_chromaticities
from .whole.defects import mend_defects
from .whole.denoising import denoise_luminance
from .whole.highlights import clipping_level, restore_highlights
from .whole.luminance import recover_luminance
from .whole.noise import with_noise
from .whole.pooling import pool_blocks
from .whole.trust import trust_in_blocks, with_trusted_colour


@dataclass(frozen=True, eq=False)
class Rendering:
    """A rendered mosaic, in scene units.

    rgb: float32 (H, W, C), one plane per channel of the pattern, not clipped; rgb = chromaticity * luminance.
    luminance: float32 (H, W), what a panchromatic pixel reads at every place.
    chromaticity: float32 (H, W, C), sum_i gamma_i chromaticity_i = 1.
    solvers: iterations and residual of each iterative solver, the worst of all parts of the frame:
        "luminance" (Eqs. 3-5), residual: largest change of a sample in the last iteration, scene units;
        "medians" (end of section 3.2), residual: share of the rows of blocks that the last iteration still changed, 0 to 1;
        "affinity" (Eqs. 11-13), residual: norm of the residual relative to the right-hand side;
        "pinning" (scattered colour sites) and "samples" (bursts), residual: the same, scaled by the diagonal.
    lost: uint8 (H, W), where a clipped shot does not tell how bright it was, 255 = not at all (`Progress.lost`); None = nowhere.

    >>> import numpy as np
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> from offline import render
    >>> mosaic = Mosaic(np.ones((24, 24), np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> rendering = render(mosaic)
    >>> rendering.luminance.shape, rendering.chromaticity.shape
    ((24, 24), (24, 24, 3))
    >>> rendering.solvers["affinity"].residual <= 1e-3
    True
    """

    rgb: FloatArray
    luminance: FloatArray
    chromaticity: FloatArray
    solvers: Mapping[str, Solved] = field(default_factory=dict)
    lost: ByteArray | None = None


def render(mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Rendering:
    """Reconstruct every channel at every pixel.

    Raises ConvergenceError when a solver does not reach its tolerance, and RangeError rather than return a value that is not
    finite.

    >>> import numpy as np
    >>> from offline import PAPER, render
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> render(grey, PAPER).rgb.shape
    (30, 40, 3)
    """
    log = SolverLog(progress)
    luminance = np.empty(mosaic.shape, np.float32)
    chromaticity = np.empty((*mosaic.shape, len(mosaic.pattern.channels)), np.float32)
    rgb = np.empty_like(chromaticity)
    for part, band in _pictures(mosaic, settings, log):
        rows = slice(part.first, part.end)
        luminance[rows], chromaticity[rows], rgb[rows] = part.luminance, part.chromaticity, band
    return Rendering(rgb, luminance, chromaticity, log.solvers, log.places)


def render_bands(mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Iterator[FloatArray]:
    """Yield the rows of `render(mosaic, settings).rgb` from top to bottom, identical to the bit, as bands float32 (rows, W, C).

    Memory: about 13 bytes per pixel while luminance is measured, then 4 bytes per pixel (luminance); everything else exists for one
    band at a time (see `rendering_memory`). Wrap `progress` in a `SolverLog` to learn what the solvers did and which light is lost.

    >>> import numpy as np
    >>> from offline import PAPER, render_bands
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((300, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> bands = list(render_bands(grey, PAPER))
    >>> len(bands), sum(len(band) for band in bands)
    (2, 300)
    """
    for _, band in _pictures(mosaic, settings, progress):
        yield band


def _pictures(mosaic: Mosaic, settings: RenderSettings, progress: Progress) -> Iterator[tuple[Part, FloatArray]]:
    """The parts of a picture, in scene units and without shading, and of each channels times luminance (Eq. 17)."""
    exponent = own_unit([mosaic])
    frame = scaled(mosaic, exponent)
    measured = measure(frame, settings, progress)
    if measured.lost is not None:
        progress.lost(measured.lost)
    for part in finish(frame, measured, settings, progress):
        luminance, band = without_shading(part, frame), np.empty_like(part.chromaticity)
        colour(part.chromaticity, luminance, band)  # Eq. 17
        check_finite(band, part.first)
        yield replace(part, luminance=in_scene_units(luminance, exponent)), in_scene_units(band, exponent)


@cache
def warm_up(settings: RenderSettings = BEST) -> None:
    """Load what a render with these settings needs, kernels and network, by rendering a tiny frame; once per program.

    A first render takes half a second longer than later ones. A program that has to wait for its shot can do that meanwhile.

    >>> from offline import PAPER, warm_up
    >>> warm_up(PAPER)
    """
    calibration = SensorCalibration(noise=NoiseModel((1e-4,) * 4, (1e-3,) * 4))
    render(Mosaic(np.full((24, 24), 0.5, np.float32), CfaPattern.bayer(), calibration), settings)


@dataclass(frozen=True, eq=False)
class Measured:
    """What is known of the whole frame before colour is spread.

    calibration: of the samples: their noise model is in it, and no shading.
    luminance: of every pixel, float32 (H, W).
    blocks: chromaticity of every block, float32 (block rows, block columns, C).
    samples: of the whole blocks; None where the settings do nothing with them.
    lost: where light is lost, uint8 (H, W), see `Cleaned`; None = nowhere.
    """

    calibration: SensorCalibration
    luminance: FloatArray
    blocks: FloatArray
    samples: BlockSamples | None
    lost: ByteArray | None


class Others(NamedTuple):
    """What the other frames of a burst know of the whole blocks of one frame.

    sums: what they add to the sums of Eqs. 8-9; None = there are no others.
    alone: how far luminance at the sites is known from this frame alone, 0 to 1, float32 (rows, columns).
    """

    sums: BlockSums | None
    alone: FloatArray


def measure(mosaic: Mosaic, settings: RenderSettings, progress: Progress) -> Measured:
    """Everything that looks at the frame as a whole.

    With shading this and `finish` see a frame that is darker towards its corners, equally for all filters, so that noise and
    saturation are those of the sensor everywhere; `without_shading` makes the light even at the end.
    """
    frame = cleaned(mosaic, settings, progress)
    luminance = recover_luminance(frame.mosaic, settings.luminance, progress)  # l, Eqs. 1-5
    luminance = denoise_luminance(luminance, frame.mosaic, settings.denoising, progress)
    return coloured(frame, luminance, settings, progress)


def cleaned(mosaic: Mosaic, settings: RenderSettings, progress: Progress) -> Cleaned:
    """The samples of a single frame without what is wrong with them: aberration, defects, clipping."""
    samples = with_noise(registered(mosaic, settings, progress).evenly_shaded(), settings.noise)
    return restored(mend_defects(Cleaned(samples, clipping_level(mosaic)), settings.defects, progress), settings, progress)


def restored(mended: Cleaned, settings: RenderSettings, progress: Progress) -> Cleaned:
    """A frame without defects with its highlights restored; what their restoration would hide is measured before."""
    trust = trust_in_blocks(mended, settings.sites)
    unclipped = unclipped_blocks(mended) if settings.highlights.restored else None
    return restore_highlights(replace(mended, trust=trust, unclipped=unclipped), settings.highlights, progress)


def coloured(
    frame: Cleaned, luminance: FloatArray, settings: RenderSettings, progress: Progress, others: Others | None = None
) -> Measured:
    """The colour of every block of a frame, and its luminance once colour is known.

    luminance: (H, W), filled in and denoised, scene units.
    others: what the other frames of a burst know.
    """
    sums = others.sums if others else None
    blocks = estimate_chromaticities(frame, luminance, settings.chromaticity, progress, sums)  # c_j, Eqs. 6-9
    blocks = pool_blocks(blocks, frame, luminance, settings.pooling, progress, sums)
    blocks = with_trusted_colour(blocks, frame)
    measured = Measured(frame.mosaic.calibration, luminance, blocks, None, frame.lost)
    if not settings.asks_for_sites:
        return measured
    samples = block_samples(frame, luminance, None if others is None else others.alone)
    luminance = settle_luminance(luminance, blocks, samples, frame.mosaic.calibration.gamma, settings.sites)
    return replace(measured, luminance=luminance, samples=samples)


def registered(mosaic: Mosaic, settings: RenderSettings, progress: Progress) -> Mosaic:
    """The mosaic as it would be if its lens had no lateral chromatic aberration (see `aberration`); itself if it has none."""
    if mosaic.calibration.aberration is None:
        return mosaic
    # At its sites a picture that is corrected shows the displaced samples themselves, and would hide what is displaced.
    rough = replace(settings, sites=SiteSettings(), learned=LearnedSettings())
    plain = replace(mosaic, calibration=replace(mosaic.calibration, aberration=None))
    progress.stage("aberration", mosaic.shape[0])
    measured = measure(plain, rough, SILENT)  # needs the most memory, and comes before what is kept beside it
    parts = (replace(part, luminance=without_shading(part, plain)) for part in finish(plain, measured, rough, SILENT))
    return without_aberration(mosaic, parts, progress)


def without_shading(part: Part, mosaic: Mosaic) -> FloatArray:
    """The luminance of a part of the picture without the shading of the mosaic's calibration, float32 (rows, W)."""
    shading, rows = mosaic.calibration.shading, slice(part.first, part.end)
    return part.luminance if shading is None else part.luminance * shading.of_plane(mosaic.shape, -1, rows)


def spread(mosaic: Mosaic, measured: Measured, settings: RenderSettings, progress: Progress) -> Iterator[Part]:
    """Spread the chromaticity of blocks to pixels, band by band."""
    pattern, luminance, blocks = mosaic.pattern, measured.luminance, measured.blocks
    sigma = noise_level(luminance, measured.calibration.noise)
    steps = bands(pattern.grid(mosaic.shape), reach(pattern.period, settings.refinement))
    progress.stage("colour", len(steps))
    initial, first = np.empty((0, mosaic.shape[1], blocks.shape[2]), np.float32), 0
    for band in steps:
        affinity = solve_affinities(luminance, pattern, settings.affinity, band, progress)  # alpha, Eqs. 11-13
        below = propagate(blocks, affinity, luminance, pattern, settings.propagation, band, progress)  # c, Eqs. 10 and 14
        initial, first = np.concatenate([initial[band.first - first :], below]), band.first
        if band.rows[0] < band.rows[1]:
            refined = refine(initial, luminance, pattern.period, sigma, settings.refinement, band, progress)  # c+
            yield Part(band.rows[0], luminance[slice(*band.rows)], refined)
        progress.advance()


def finish(mosaic: Mosaic, measured: Measured, settings: RenderSettings, progress: Progress) -> Iterator[Part]:
    """Correct what has been spread by the samples at the colour sites, and by what is learned, band by band."""
    sites, gamma = measured.samples, mosaic.calibration.gamma
    parts = spread(mosaic, measured, settings, progress)
    if sites is None:
        yield from parts
        return
    if mosaic.pattern.is_scattered and settings.sites.corrected:
        pinning = Pinning(measured.blocks, sites, gamma, settings.sites, progress)
        for part, rows in windows(parts, mosaic.shape[0], *pinning.steps):
            progress.part("sites")
            yield pinning.applied(part, rows)
        return
    learner = learner_for(mosaic.pattern, gamma, settings.learned)
    look, step, origin = learner.steps(sites) if learner else (sites.reach, 1, 0)
    for part, rows in windows(parts, mosaic.shape[0], look, step, origin):
        progress.part("sites")
        corrected = correct_sites(part, sites, gamma, settings.sites)
        if learner:
            progress.part("learned")
            corrected = learner.refine(part, corrected, sites, rows)
        yield corrected.rows(*rows)
