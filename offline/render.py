"""The full-quality render on one page: mosaic -> luminance -> chromaticity -> affinity -> propagation -> refinement -> RGB.

Mending, restoring, denoising and pooling are not of the paper: they are what the preset BEST adds for defective samples, for too
much light and for too little.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from shared.arrays import FloatArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from .affinity import core_patches, solve_affinities, solve_patches
from .chromaticity import estimate_chromaticities
from .defects import mend_defects
from .denoising import denoise_luminance
from .highlights import clipping_level, restore_highlights
from .luminance import recover_luminance
from .noise import noise_of
from .pooling import pool_blocks
from .propagation import propagate, propagate_patches
from .refinement import noise_level, reach, refine, refine_rows
from .settings import BEST, RenderSettings
from .tiling import Band, bands


@dataclass(frozen=True, eq=False)
class Rendering:
    """A rendered mosaic, in scene units.

    rgb: float32 (H, W, C), one plane per channel of the pattern, unclipped; luminance: float32 (H, W), the panchromatic reading of
    every pixel; chromaticity: float32 (H, W, C), rgb = chromaticity * luminance and sum_i gamma_i chromaticity_i = 1.
    """

    rgb: FloatArray
    luminance: FloatArray
    chromaticity: FloatArray


def render(mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Rendering:
    """Reconstruct every channel at every pixel. Raises ConvergenceError when a solver does not reach its tolerance."""
    noise, clipping = noise_of(mosaic, settings.noise), clipping_level(mosaic)
    mended = mend_defects(mosaic, clipping, noise, settings.defects, progress)
    sound = restore_highlights(mended, clipping, settings.highlights, progress)
    filled = recover_luminance(sound, settings.luminance, progress)  # l, Eqs. 1-5
    luminance = denoise_luminance(filled, sound, noise, settings.denoising, progress)
    measured = estimate_chromaticities(sound, luminance, settings.chromaticity, progress)  # c_j, Eqs. 6-9
    blocks = pool_blocks(measured, sound, luminance, noise, settings.pooling, progress)
    affinity = solve_affinities(luminance, mosaic.pattern, settings.affinity, progress)  # alpha, Eqs. 11-13
    initial = propagate(blocks, affinity, luminance, mosaic.pattern, settings.propagation)  # c, Eqs. 10 and 14
    refined = refine(initial, luminance, mosaic, settings.refinement, progress)  # c+, Eqs. 15-16
    return Rendering(refined * luminance[..., None], luminance, refined)  # Eq. 17


def render_bands(mosaic: Mosaic, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Iterator[FloatArray]:
    """The rows of `render(mosaic, settings).rgb` from top to bottom, to the bit, as bands float32 (rows, W, C).

    Beside the mosaic only the luminance is there as a whole, and a mended copy of the samples if there was anything to mend: eight
    or twelve bytes a pixel with the mosaic's signal.
    """
    noise, clipping = noise_of(mosaic, settings.noise), clipping_level(mosaic)
    mended = mend_defects(mosaic, clipping, noise, settings.defects, progress)
    if mended is not mosaic:
        mosaic.forget()
    mosaic = restore_highlights(mended, clipping, settings.highlights, progress)
    if mosaic is not mended:
        mended.forget()
    del mended
    luminance = recover_luminance(mosaic, settings.luminance, progress)
    luminance = denoise_luminance(luminance, mosaic, noise, settings.denoising, progress)
    blocks = estimate_chromaticities(mosaic, luminance, settings.chromaticity, progress)
    blocks = pool_blocks(blocks, mosaic, luminance, noise, settings.pooling, progress)
    sigma = noise_level(luminance, mosaic)
    pattern = mosaic.pattern
    steps = _bands(mosaic, settings)
    progress.stage("colour", len(steps))
    initial, first = np.empty((0, mosaic.shape[1], blocks.shape[2]), np.float32), 0
    for band in steps:
        affinity = solve_patches(luminance, pattern, settings.affinity, band.patches)
        following = propagate_patches(blocks, affinity, luminance, pattern, settings.propagation, band.patches[0])
        initial = np.concatenate([initial, following])
        refined = refine_rows(initial, first, luminance, pattern.period, sigma, settings.refinement, band.rows)
        initial, first = initial[band.kept - first :].copy(), band.kept
        progress.advance()
        if len(refined):
            yield refined * luminance[slice(*band.rows), :, None]


def band_rows(mosaic: Mosaic, settings: RenderSettings = BEST) -> int:
    """At most so many rows does `render_bands` work on at a time: what it needs beside whole planes grows with them."""
    period = mosaic.pattern.period
    look = 2 * reach(period, settings.refinement)
    return max((band.patches[1] - band.patches[0]) * period for band in _bands(mosaic, settings)) + look


def _bands(mosaic: Mosaic, settings: RenderSettings) -> list[Band]:
    pattern = mosaic.pattern
    return bands(pattern.grid(mosaic.shape), core_patches(pattern.period), reach(pattern.period, settings.refinement))
