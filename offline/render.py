"""The full-quality render on one page: mosaic -> luminance -> chromaticity -> affinity -> propagation -> refinement -> RGB.

Mending, restoring, denoising and pooling are not in the paper: the preset BEST adds them for defective samples, for too much light
and for too little.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from math import ceil
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter

from shared.arrays import ByteArray, FloatArray
from shared.calibration import NoiseModel, SensorCalibration
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from .kernels.aberration import undo_aberration
from .kernels.mixing import colour
from .rows.affinity import solve_affinities
from .rows.learned import learner_for
from .rows.pinning import Pinning
from .rows.propagation import propagate
from .rows.refinement import noise_level, reach, refine
from .settings import BEST, LearnedSettings, RenderSettings, SiteSettings
from .sites import SiteSamples, correct_sites, settle_luminance, site_samples, unclipped_blocks
from .solvers import Solved, SolverLog
from .tiling import Part, bands, windows
from .units import check_finite, in_scene_units, own_unit, scaled
from .whole.chromaticity import estimate_chromaticities
from .whole.defects import mend_defects
from .whole.denoising import denoise_luminance
from .whole.highlights import clipping_level, restore_highlights
from .whole.luminance import recover_luminance
from .whole.noise import noise_of
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
    for part in finish(frame, measure(frame, settings, progress), settings, progress):
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


class Measured(NamedTuple):
    """What is known of the whole frame before colour is spread.

    luminance: of every pixel, float32 (H, W).
    blocks: chromaticity of every block, float32 (block rows, block columns, C).
    sites: the samples of the whole blocks; None where the settings do nothing with them.
    """

    luminance: FloatArray
    blocks: FloatArray
    sites: SiteSamples | None


def measure(mosaic: Mosaic, settings: RenderSettings, progress: Progress) -> Measured:
    """Everything that looks at the frame as a whole.

    With shading this and `finish` see a frame that is darker towards its corners, equally for all filters, so that noise and
    saturation are those of the sensor everywhere; `without_shading` makes the light even at the end.
    """
    clipping, samples = clipping_level(mosaic), registered(mosaic, settings, progress).evenly_shaded()
    noise = noise_of(samples, settings.noise)
    samples = mend_defects(samples, clipping, noise, settings.defects, progress)
    trust = trust_in_blocks(samples, clipping, noise, settings.sites)
    unclipped = unclipped_blocks(samples, clipping) if settings.asks_for_sites else None
    samples = restore_highlights(samples, clipping, settings.highlights, progress)
    luminance = recover_luminance(samples, settings.luminance, progress)  # l, Eqs. 1-5
    luminance = denoise_luminance(luminance, samples, noise, settings.denoising, progress)
    blocks = estimate_chromaticities(samples, luminance, settings.chromaticity, progress)  # c_j, Eqs. 6-9
    blocks = pool_blocks(blocks, samples, luminance, noise, settings.pooling, progress)
    blocks = with_trusted_colour(blocks, trust, mosaic)
    if unclipped is None:
        return Measured(luminance, blocks, None)
    sites = site_samples(samples, unclipped, luminance, noise)
    del samples  # a plane of the frame, before another one is needed
    luminance = settle_luminance(luminance, blocks, sites, mosaic.calibration.gamma, settings.sites)
    return Measured(luminance, blocks, sites)


def registered(mosaic: Mosaic, settings: RenderSettings, progress: Progress) -> Mosaic:
    """The mosaic as it would be if its lens had no lateral chromatic aberration; the mosaic itself if it has none.

    A first picture, rendered as if there were none, tells how much the displacement of channels changes each sample. What is not in
    that picture, such as noise, stays as it is. Samples that are saturated stay so, with those around them that their light
    reaches; none loses more than half of its light.
    """
    lens = mosaic.calibration.aberration
    if lens is None:
        return mosaic
    # At its sites a picture that is corrected shows the displaced samples themselves, and would hide what is displaced.
    rough = replace(settings, sites=SiteSettings(), learned=LearnedSettings())
    plain = replace(mosaic, calibration=replace(mosaic.calibration, aberration=None))
    planes, (height, _) = mosaic.pattern.filter_map((mosaic.pattern.period,) * 2), mosaic.shape
    radial, gamma = np.array(lens.radial), np.array(mosaic.calibration.gamma, np.float32)
    progress.stage("aberration", height)
    measured = measure(plain, rough, SILENT)  # needs the most memory, and comes before what is kept beside it
    is_coded, reach = mosaic.samples.dtype == np.uint16, ceil(lens.reach(mosaic.shape))
    signal = mosaic.signal if is_coded else mosaic.signal.copy()
    signal.flags.writeable = True  # codes become a new array
    for part, (first, end) in windows(finish(plain, measured, rough, SILENT), height, reach + 2, 1, 0):
        picture, rows = np.empty_like(part.chromaticity), slice(first, end)
        colour(part.chromaticity, without_shading(part, plain), picture)
        changed = signal[rows].copy()
        undo_aberration(picture, part.first, height, radial, gamma, planes, first, changed)
        # Beside strong edges the first picture may be wrong by more than a dark sample, which would become a black dot.
        np.maximum(changed, np.minimum(signal[rows], signal[rows] / 2), out=changed)
        if is_coded:  # how bright and of which colour what is saturated is, is a guess, and would change what its light reaches
            around = slice(max(first - reach - 1, 0), end + reach + 1)
            saturated = maximum_filter(mosaic.samples[around] >= mosaic.calibration.white_level, 2 * reach + 3)
            np.copyto(changed, signal[rows], where=saturated[first - around.start :][: len(changed)])
        signal[rows] = changed
        progress.advance(end - first)
    signal.flags.writeable = False
    return replace(plain, samples=signal)


def without_shading(part: Part, mosaic: Mosaic) -> FloatArray:
    """The luminance of a part of the picture without the shading of the mosaic's calibration, float32 (rows, W)."""
    shading, rows = mosaic.calibration.shading, slice(part.first, part.end)
    return part.luminance if shading is None else part.luminance * shading.of_plane(mosaic.shape, -1, rows)


def spread(mosaic: Mosaic, measured: Measured, settings: RenderSettings, progress: Progress) -> Iterator[Part]:
    """Spread the chromaticity of blocks to pixels, band by band."""
    pattern, (luminance, blocks, _) = mosaic.pattern, measured
    sigma = noise_level(luminance, mosaic)
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
    sites, gamma = measured.sites, mosaic.calibration.gamma
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
