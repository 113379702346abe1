"""The full-quality render on one page: mosaic -> cleaned -> luminance -> colour of blocks -> colour
of pixels, row by row -> RGB.

The preset BEST uses stages that are not in the paper. Which stages in rows a frame needs is decided
in `row_stages` alone; those that look at the whole frame return what they got where their settings
do not use them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..shared import ByteArray, FloatArray, InputError, Mosaic, NoiseModel
from ..shared.networks import network_for
from ..shared.progress import SILENT, Progress
from .bands import Band, Halo, RowStage, run_stages
from .frame import BlockSums, Frame
from .patches import band_rows
from .settings import BEST, RenderSettings
from .stages.block_network import learned_chromaticities, serves
from .stages.chromaticity import estimate_chromaticities
from .stages.colour_network import ColourNetwork
from .stages.correction import Correction, SiteResidual, fill_error, update_luminance
from .stages.defects import mend_defects
from .stages.denoising import denoise_luminance
from .stages.highlights import clipping_level, restore_highlights
from .stages.luminance import recover_luminance
from .stages.noise import noise_models
from .stages.pooling import pool_blocks
from .stages.propagation import Propagation, apply_luminance
from .stages.refinement import Refinement
from .stages.shading import ShadingCorrection
from .units import check_finite, check_frames

Stages = Callable[[Frame, RenderSettings], list[RowStage]]
"""Makes the list of stages in rows, as `row_stages` does."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """A rendered mosaic, in scene units.

    Attributes
    ----------
    rgb : FloatArray
        float32 (H, W, C), one plane per channel of the pattern, not clipped; rgb = chromaticity *
        luminance.
    luminance : FloatArray
        float32 (H, W), what a panchromatic pixel reads at every place.
    chromaticity : FloatArray
        float32 (H, W, C), sum_i gamma_i chromaticity_i = 1.
    lost : ByteArray | None
        uint8 (H, W), where a clipped shot does not tell how bright it was, nor of which colour: a
        picture to look at is white there. 255 = nothing is known; None = all is known.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> from panchroma.offline import render
    >>> mosaic = Mosaic(np.ones((24, 24), np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> rendering = render(mosaic)
    >>> rendering.luminance.shape, rendering.chromaticity.shape
    ((24, 24), (24, 24, 3))
    """

    rgb: FloatArray
    luminance: FloatArray
    chromaticity: FloatArray
    lost: ByteArray | None = None


def row_stages(frame: Frame, settings: RenderSettings) -> list[RowStage]:
    """The stages that make a picture of what was measured, in their order. Every choice among them
    is made here.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import BEST, measure, row_stages
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> [stage.name for stage in row_stages(measure(grey), BEST)][0]
    'propagation'
    """
    # c, Eqs. 10-14
    stages: list[RowStage] = [Propagation(frame, settings.affinity, settings.propagation)]
    if settings.refinement.repetitions:  # c+, Eqs. 15-16
        stages.append(Refinement(frame, settings.refinement))
    if frame.fill_error.size:
        stages.append(SiteResidual(frame))
        if settings.correction.used:
            stages.append(Correction(frame))
        if settings.learned.used and (network := network_for(frame.pattern)):
            stages.append(ColourNetwork(network, frame))
    if frame.shading is not None:
        stages.append(ShadingCorrection(frame))
    return stages


def render(
    mosaic: Mosaic,
    settings: RenderSettings = BEST,
    progress: Progress = SILENT,
    stages: Stages = row_stages,
) -> Rendering:
    """Reconstruct every channel at every pixel.

    Parameters
    ----------
    stages : Stages, optional
        Makes the list of stages in rows; by default `row_stages`. One's own may add to that list,
        replace in it, or leave out.

    Raises
    ------
    InputError
        For samples that are not in scene units.
    ConvergenceError
        When a solver does not reach its tolerance.
    RangeError
        Rather than return a value that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import PAPER, render, row_stages
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> render(grey, PAPER).rgb.shape
    (30, 40, 3)
    >>> without_the_last = render(grey, stages=lambda *given: row_stages(*given)[:-1])
    """
    measured = measure(mosaic, settings, progress)
    luminance = np.empty(mosaic.shape, np.float32)
    chromaticity = np.empty((*mosaic.shape, len(measured.gamma)), np.float32)
    rgb = np.empty_like(chromaticity)
    for band in run_row_stages(measured, settings, progress, stages):
        rows = slice(band.first, band.end)
        _apply_luminance(band, rgb[rows])
        luminance[rows], chromaticity[rows] = band.luminance, band.chromaticity
    return Rendering(rgb, luminance, chromaticity, measured.lost)


def render_bands(
    mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT
) -> Iterator[FloatArray]:
    """Yield the rows of `render(mosaic, settings).rgb` from top to bottom, identical to the bit, as
    bands float32 (rows, W, C).

    Memory: about 11 bytes per pixel while luminance is measured, then 9 (samples, luminance);
    all else exists for one band at a time (see `rendering_memory`). Call `measure`
    and `colour_bands` instead of this to learn which light is lost (`Frame.lost`).

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import PAPER, render_bands
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((300, 40), 0.75, np.float32), CfaPattern.bayer(6),
    ...     SensorCalibration())
    >>> bands = list(render_bands(grey, PAPER))
    >>> len(bands), sum(len(band) for band in bands)
    (2, 300)
    """
    yield from colour_bands(measure(mosaic, settings, progress), settings, progress)


def colour_bands(
    measured: Frame,
    settings: RenderSettings = BEST,
    progress: Progress = SILENT,
    stages: Stages = row_stages,
) -> Iterator[FloatArray]:
    """Yield the picture of what was measured, as `render_bands` does.

    Parameters
    ----------
    stages : Stages, optional
        See `render`.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import colour_bands, measure
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> [band.shape for band in colour_bands(measure(grey))]
    [(30, 40, 3)]
    """
    for band in run_row_stages(measured, settings, progress, stages):
        yield _apply_luminance(band, np.empty_like(band.chromaticity))


def measure(mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Frame:
    """Everything that looks at a single frame as a whole.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import measure
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> measure(grey).luminance.shape
    (30, 40)
    """
    frame = clean_frame(mosaic, settings, progress)
    luminance = recover_luminance(frame.mosaic, settings.luminance, progress)  # l, Eqs. 1-5
    luminance = denoise_luminance(luminance, frame.mosaic, settings.denoising, progress)
    return estimate_colour(frame, luminance, settings, progress)


def clean_frame(
    mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT
) -> Frame:
    """The samples of a single frame without what is wrong with them: defects, clipping.

    With shading the frame stays darker towards its corners, equally for all filters, so that noise
    and saturation are those of the sensor everywhere; the last stage makes the light even.

    Raises
    ------
    InputError
        For samples that are not in scene units.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import clean_frame
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> bool((clean_frame(grey).signal == grey.signal).all())
    True
    """
    check_frames([mosaic], settings)
    noise = mosaic.calibration.noise
    if settings.noise.estimate:
        (noise,) = noise_models([mosaic], settings.noise)
    # No name keeps the samples with their defects while highlights are restored, which needs the
    # most memory.
    frame = mend_frame(mosaic, noise, settings, progress)
    return restore_highlights(frame, settings.highlights, progress)


def mend_frame(
    mosaic: Mosaic, noise: NoiseModel | None, settings: RenderSettings, progress: Progress = SILENT
) -> Frame:
    """A frame without defects, shaded equally for all filters (`Mosaic.evenly_shaded`).

    Parameters
    ----------
    noise : NoiseModel | None
        See `noise_models`.
    """
    calibration = replace(mosaic.calibration, noise=noise and noise.possible())
    samples = mosaic.calibrated(calibration).evenly_shaded()
    estimated, limit = mosaic.calibration.noise is None, clipping_level(mosaic, calibration.noise)
    frame = Frame(samples, limit, estimated=estimated, shading=mosaic.calibration.shading)
    return mend_defects(frame, settings.defects, progress)


def estimate_colour(
    frame: Frame,
    luminance: FloatArray,
    settings: RenderSettings = BEST,
    progress: Progress = SILENT,
    others: BlockSums | None = None,
    alone: FloatArray | None = None,
) -> Frame:
    """The colour of every block of a frame, and the luminance that this makes most probable.

    Parameters
    ----------
    luminance : FloatArray
        (H, W), filled in and denoised, scene units; as float32 it is not copied.
    others : BlockSums | None, optional
        What the other frames of a burst add to the sums of Eqs. 8-9; None = there are no others.
    alone : FloatArray | None, optional
        How far luminance at the sites of the whole blocks is known from this frame alone, 0 to 1,
        float32 (rows, columns); None = all of it.

    Raises
    ------
    InputError
        For luminance of another shape, or that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import clean_frame, estimate_colour
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> estimate_colour(clean_frame(grey), np.full((30, 40), 0.75, np.float32)).blocks.shape[2]
    3
    """
    given = np.asarray(luminance)
    with np.errstate(over="ignore", invalid="ignore"):
        usable = given.dtype.kind in "fiu" and np.isfinite(given.sum(dtype=np.float32))
    if not usable or given.shape != frame.shape:
        expected = f"expected finite numbers, float32 {frame.shape}"
        raise InputError(f"luminance is {given.dtype} {given.shape}, {expected}")
    luminance = np.require(given, np.float32, ["C", "W"])
    frame, lines = replace(frame, luminance=luminance, others=others, kept=alone), frame.lines
    medians, pooling = settings.chromaticity, settings.pooling
    if medians.learned and serves(frame.pattern):
        blocks, lines = learned_chromaticities(frame, medians, pooling, progress)
    else:  # c_j, Eqs. 6-9
        blocks = estimate_chromaticities(frame, medians, progress)
        blocks = pool_blocks(blocks, frame, pooling, progress)
    frame = replace(frame, blocks=blocks, lines=lines, others=None)
    if not settings.asks_for_sites:
        return frame
    error = fill_error(frame)
    frame = replace(frame, fill_error=error if alone is None else error * alone)
    return replace(frame, luminance=update_luminance(frame)) if settings.posterior.used else frame


def run_row_stages(
    measured: Frame,
    settings: RenderSettings = BEST,
    progress: Progress = SILENT,
    stages: Stages = row_stages,
) -> Iterator[Band]:
    """The picture of what was measured, in bands, in scene units."""
    made, grey = list(stages(measured, settings)), _grey_bands(measured, progress)
    for stage in made:
        halo: Any = getattr(stage, "halo", None) if callable(stage) else None
        whole = isinstance(halo, Halo) and all(isinstance(number, int) for number in halo)
        if isinstance(stage, type) or not whole or halo.radius < 0 or halo.alignment < 1:
            kind = "offline.RowStage objects whose Halo has a radius from 0, an alignment from 1 on"
            raise InputError(f"stages made a list with {stage!r}, expected {kind}")
    return iter(run_stages(grey, made, measured.shape[0], progress))


def _grey_bands(measured: Frame, progress: Progress) -> Iterator[Band]:
    """The picture without colour."""
    steps, grey = band_rows(measured.grid), np.float32(measured.mosaic.calibration.grey)
    progress.stage("colouring pixels", len(steps))
    for first, end in steps:
        luminance = measured.luminance[first:end]
        yield Band(first, luminance, np.full((*luminance.shape, len(measured.gamma)), grey))
        progress.advance()


def _apply_luminance(band: Band, rgb: FloatArray) -> FloatArray:
    """Write each channel of a band times luminance into `rgb` (Eq. 17), and return that."""
    apply_luminance(band.chromaticity, np.ascontiguousarray(band.luminance), rgb)
    check_finite(rgb, band.first)
    return rgb
