"""What each step of the reconstruction is worth, and what it costs: cheaper ones, dearer ones, and none."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from device import Preview
from offline import BEST, PAPER, PRESETS, render, use_threads
from shared import CfaPattern, Mosaic
from shared.arrays import FloatArray
from tools.camera.protocols import Protocol
from tools.evaluation.cameras import CameraPair
from tools.evaluation.methods import render_preset
from tools.evaluation.metrics import quality
from tools.scenes.scene import Scene

MEASURES = "median RGB", "luminance", "chrominance", "10 % RGB", "10 % chrominance", "CPU s per MP"
_FAST = replace(PAPER.luminance, iterations=13, decay=0.5)  # ends at the same threshold, in a quarter of the steps
_SLOW = replace(PAPER.luminance, iterations=200, decay=2**-0.0625)
_FILLED = replace(BEST.luminance, learned=False)
_UNCORRECTED = replace(BEST.switched(False), luminance=_FILLED, chromaticity=replace(BEST.chromaticity, mismatch=0.0))
STEPS = {
    "`paper`": PAPER,
    "`paper`, luminance in 13 iterations, not 50": replace(PAPER, luminance=_FAST),
    "`paper`, luminance in 200 iterations": replace(PAPER, luminance=_SLOW),
    "`paper`, no medians": replace(PAPER, chromaticity=replace(PAPER.chromaticity, taps=1)),
    "`paper`, no refinement": replace(PAPER, refinement=BEST.refinement),
    "`best`": BEST,
    "`best`, no network for luminance": replace(BEST, luminance=_FILLED),
    "`best`, no networks": PRESETS["unlearned"],
    "`best`, no networks, no correction by the samples": _UNCORRECTED,
    "`best`, luminance not denoised": replace(BEST, denoising=PAPER.denoising),
    "`best`, colour not pooled": replace(BEST, pooling=PAPER.pooling),
    "`best`, with refinement": replace(BEST, refinement=PAPER.refinement),
}


def steps(scene: Scene, level: Protocol) -> Iterator[tuple[str, list[float]]]:
    """Name and MEASURES of each variant, the paper's camera, K = 6."""
    use_threads(1)  # so that the processor's time is that of the work
    mosaic = CameraPair(level, 0, scene.rgb, CfaPattern.bayer(6), None).sparse
    small = Mosaic(mosaic.samples[:60, :60], mosaic.pattern, mosaic.calibration)
    for name, make in _variants(mosaic, scene.rgb).items():
        make(small)  # loads what is compiled
        start = time.process_time()
        picture = make(mosaic) / np.float32(level.light)
        seconds = time.process_time() - start
        found = quality(picture, scene.rgb)
        yield name, [*found.median, found.rgb[0], found.chrominance[0], 1e6 * seconds / mosaic.samples.size]


def _variants(mosaic: Mosaic, truth: FloatArray) -> dict[str, Callable[[Mosaic], FloatArray]]:
    preview = Preview.for_mosaic(mosaic, scale=1, linear=True, threads=1)  # for frames of one size

    def with_true_luminance(mosaic: Mosaic) -> FloatArray:
        """What the best luminance inpainting could still gain in Eq. 17."""
        rendering, (rows, columns) = render(mosaic, PAPER), mosaic.shape
        known = mosaic.pattern.panchromatic_mask(mosaic.shape)
        luminance = np.where(known, rendering.luminance, truth[:rows, :columns].sum(axis=2))
        return rendering.chromaticity * luminance[..., None]

    rendered = {name: partial(render_preset, settings) for name, settings in STEPS.items()}
    return {
        "`preview`, on the camera": lambda _: np.asarray(preview.run(mosaic), np.float32),
        **rendered,
        "`paper`, true luminance at the colour sites": with_true_luminance,
    }
