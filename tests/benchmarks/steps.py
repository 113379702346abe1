"""What is each step of the reconstruction worth? python -m tests.benchmarks.steps SCENE... [--sigma
0 0.01 0.03] [--size 360]

Means over the scenes, the paper's camera, K = 6, in Markdown: PSNR in dB of 10 x 10 patches (median
or 10 % quantile) and of the whole picture, and the time of one core.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from panchroma.offline import BEST, PAPER, PRESETS, render, use_threads
from panchroma.shared import FloatArray, Mosaic
from panchroma.tools.evaluation.cameras import CameraPair
from panchroma.tools.evaluation.methods import render_preset
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.protocols import PaperProtocol
from tests.benchmarks.harness import PATTERN, middle, options, psnrs

FIGURES = "median RGB", "10 % RGB", "whole RGB", "CPU s per MP"
_FILLED = replace(BEST.luminance, learned=False)
STEPS = {
    "`paper`": PAPER,
    "`paper`, no medians": replace(PAPER, chromaticity=replace(PAPER.chromaticity, repetitions=0)),
    "`paper`, no refinement": replace(PAPER, refinement=BEST.refinement),
    "`paper`, refined five times": replace(
        PAPER, refinement=replace(PAPER.refinement, repetitions=5)
    ),
    "`best`": BEST,
    "`best`, no network for luminance": replace(BEST, luminance=_FILLED),
    "`best`, no networks": PRESETS["unlearned"],
    "`best`, no network for blocks": replace(
        BEST, chromaticity=replace(BEST.chromaticity, learned=False)
    ),
    "`best`, no networks, no correction by the samples": replace(
        PRESETS["unlearned"], correction=PAPER.correction, posterior=PAPER.posterior
    ),
    "`best`, luminance not denoised": replace(BEST, denoising=PAPER.denoising),
    "`best`, colour not pooled": replace(BEST, pooling=PAPER.pooling),
}


def with_true_luminance(truth: FloatArray, mosaic: Mosaic) -> FloatArray:
    """What the best luminance inpainting could still gain in Eq. 17."""
    rendering, (rows, columns) = render(mosaic, PAPER), mosaic.shape
    known = mosaic.pattern.panchromatic_mask(mosaic.shape)
    luminance = np.where(known, rendering.luminance, truth[:rows, :columns].sum(axis=2))
    return rendering.chromaticity * luminance[..., None]


def measure(make: Callable[[Mosaic], FloatArray], mosaic: Mosaic, truth: FloatArray) -> list[float]:
    """The FIGURES of a step."""
    # loads what is compiled
    make(Mosaic(mosaic.samples[:60, :60], mosaic.pattern, mosaic.calibration))
    start = time.process_time()
    picture = make(mosaic)
    seconds = time.process_time() - start
    return [*psnrs(picture, truth), 1e6 * seconds / mosaic.samples.size]


def main() -> None:
    """Print the table."""
    given = options(__doc__, "+", sigma=[0.0, 0.01, 0.03], size=360)
    use_threads(1)  # so that the processor's time is that of the work
    rows: dict[tuple[float, str], list[list[float]]] = defaultdict(list)
    for source in given.scenes:
        truth = middle(load_scene(source).rgb, given.size)
        steps = {name: partial(render_preset, settings) for name, settings in STEPS.items()}
        steps["`paper`, true luminance at the colour sites"] = partial(with_true_luminance, truth)
        for sigma in given.sigma:
            mosaic = CameraPair(PaperProtocol(sigma), 0, truth, PATTERN, None).sparse
            for name, make in steps.items():
                rows[sigma, name].append(measure(make, mosaic, truth))
    print(f"| sigma | | {' | '.join(FIGURES)} |\n|{'---|' * (len(FIGURES) + 2)}")
    for (sigma, name), found in rows.items():
        cells = " | ".join(f"{each:.3g}" for each in np.mean(found, axis=0))
        print(f"| {sigma:g} | {name} | {cells} |")


if __name__ == "__main__":
    main()
