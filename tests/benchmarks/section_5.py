"""Try the proposals of the paper's section 5: python -m tests.benchmarks.section_5 SCENE... [--study STUDY...] [--sigma S...]

Studies, each a table in Markdown:

steps    other steps of the reconstruction, cheaper and dearer
bands    eight narrow bands, against three channels and a guess, and against a mosaic of bands; takes spectral:WIDTHxHEIGHT

The first takes photographs, and prints means over all of them. PSNR is in dB: of 10 x 10 patches the median or the 10 % quantile,
or that of the whole image, always in the scene's red, green and blue, whatever the filters are. All cameras get the same light.
"""

import string
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial
from itertools import product

import numpy as np

from device import Preview
from offline import BEST, PAPER, PRESETS, render, use_threads
from shared import CfaPattern, Mosaic
from shared.arrays import BoolArray, DoubleArray, FloatArray
from shared.errors import InputError
from tests.benchmarks.harness import PATTERN, options
from tests.benchmarks.spectral import BANDS, spectral_scene
from tools.evaluation.cameras import CameraPair
from tools.evaluation.methods import render_preset
from tools.evaluation.metrics import BORDER, quality
from tools.evaluation.rivals.planes import denoised_planes, planes
from tools.evaluation.scene_sets import cut
from tools.io.scene import Scene
from tools.simulation.filters import filters_for
from tools.simulation.load import load_scene
from tools.simulation.noise import PaperProtocol, Protocol, SensorProtocol
from tools.simulation.simulated_camera import SimulatedCamera

OF_STEPS = "median RGB", "luminance", "chrominance", "10 % RGB", "10 % chrominance", "CPU s per MP"
_FAST = replace(PAPER.luminance, iterations=13, decay=0.5)  # ends at the same threshold, in a quarter of the steps
_SLOW = replace(PAPER.luminance, iterations=200, decay=2**-0.0625)
_FILLED = replace(BEST.luminance, learned=False)
_UNCORRECTED = replace(BEST.switched(False), luminance=_FILLED)
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
    """Name and OF_STEPS of each variant, the paper's camera, K = 6."""
    use_threads(1)  # so that the processor's time is that of the work
    mosaic = CameraPair(level, 0, scene.rgb, PATTERN, None).sparse
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


OF_BANDS = "luminance", "median RGB", "chrominance", "RMS of bands", "mean angle", "angle where RGB errs"
BLOCKS = "HIJ/KWL/NOP", "HIJK/LNOP"
PERIODS = 6, 8, 10
MOSAIC = "HIJ/KWL/NOP"  # the tile of the traditional mosaic
_ERRS = 10.0  # degrees from the truth, of what is guessed from perfect red, green and blue


def bands(scene: Scene, level: Protocol) -> Iterator[tuple[str, list[float]]]:
    """Name and OF_BANDS of each way to the bands: of the picture in red, green and blue (PSNR, dB), and of the spectra."""
    truth, unlearned = Truth(scene), partial(render_preset, PRESETS["unlearned"])
    guessed = truth.filters @ truth.guess  # bands that three filters show
    yield "perfect R, G, B; bands guessed", truth.measured(scene.rgb @ guessed)
    for period in (4, 6):
        picture = rendered("RG/GB", period, scene, level, unlearned)
        yield f"sparse `RG/GB`, K = {period}; bands guessed", truth.measured(picture @ guessed)
    for block, period in product(BLOCKS, PERIODS):
        picture = rendered(block, period, scene, level, unlearned)
        yield f"sparse `{block}`, K = {period}", truth.measured(picture)
    yield f"mosaic `{MOSAIC}`, planes interpolated", truth.measured(rendered(MOSAIC, 3, scene, level, planes))
    if not level.clear:
        yield f"mosaic `{MOSAIC}`, BM3D, planes interpolated", truth.measured(rendered(MOSAIC, 3, scene, level, denoised_planes))


def rendered(block: str, period: int, scene: Scene, level: Protocol, method: Callable[[Mosaic], FloatArray]) -> FloatArray:
    """A shot as rendered by a method, in the scene's bands by the pseudo-inverse of the filters, as bright as the scene.

    block: rows separated by "/"; there is one in every `period` pixels.
    """
    letters = "".join(sorted(set(block) - set("/W"), key=("RGB" + string.ascii_uppercase).index))
    pattern = CfaPattern.with_block(tuple(block.split("/")), period, channels=letters)
    filters = filters_for(pattern, scene)
    camera = SimulatedCamera.of(pattern, protocol=level.scaled(filters.unit), bits=level.bits)
    shot = camera.shoot(replace(scene, camera_to_xyz=None, neutral=None), np.random.default_rng(0)).mosaic
    return method(shot) / np.float32(level.light) @ np.linalg.pinv(np.array(filters.matrix)).T.astype(np.float32)


class Truth:
    """A scene of eight bands, and what can be known of it from red, green and blue alone."""

    def __init__(self, scene: Scene) -> None:
        self.bands = scene.rgb
        self.filters = np.array(filters_for(PATTERN, scene).matrix, np.float32).T

    @cached_property
    def rgb(self) -> FloatArray:
        """What red, green and blue filters read, (H, W, 3)."""
        return self.bands @ self.filters

    @cached_property
    def guess(self) -> FloatArray:
        """Matrix (3, 8) from R, G, B to bands: least squares over this very scene, the best case for three channels."""
        return np.linalg.lstsq(self.rgb.reshape(-1, 3), self.bands.reshape(-1, 8))[0]

    @cached_property
    def _mistaken(self) -> BoolArray:
        """Pixels whose spectrum three channels do not tell from others that are more frequent."""
        return self._angles(self.rgb @ self.guess) > _ERRS

    def measured(self, picture: FloatArray) -> list[float]:
        """The figures OF_BANDS of a picture, (H, W, 8)."""
        found = quality(picture @ self.filters, self.rgb)
        angles = self._angles(picture)
        error = (picture - self.bands)[BORDER:-BORDER, BORDER:-BORDER]
        rms = float(np.sqrt(np.mean(error.astype(np.float64) ** 2)))
        medians = found.luminance[2], found.rgb[2], found.chrominance[2]
        return [*medians, rms, float(angles.mean()), float(angles[self._mistaken].mean())]

    def _angles(self, picture: FloatArray) -> DoubleArray:
        """Angles between spectra, degrees: how different they are whatever their brightness."""
        one, two = (each[BORDER:-BORDER, BORDER:-BORDER].astype(np.float64) for each in (picture, self.bands))
        cosine = (one * two).sum(axis=2) / np.maximum(np.linalg.norm(one, axis=2) * np.linalg.norm(two, axis=2), 1e-12)
        return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))


Rows = dict[tuple[str, str], list[list[float]]]
"""Figures of a table: by noise and by what is tried, one list for each scene."""
Study = Callable[[Scene, Protocol], Iterator[tuple[str, list[float]]]]
# Title, names of the figures, study.
STUDIES: dict[str, tuple[str, tuple[str, ...], Study]] = {
    "steps": ("Steps of the reconstruction", OF_STEPS, steps),
    "bands": ("Eight bands", OF_BANDS, bands),
}


def _sides(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def main() -> None:
    """Print the tables."""
    studies = {"nargs": "+", "choices": STUDIES, "default": list(STUDIES)}
    noise = {"nargs": "*", "type": float, "default": [0, 0.01, 0.03], "help": "additive noise, as in the paper"}
    light = {"nargs": "*", "type": float, "default": [], "help": "noise of a sensor in this part of the scene's light"}
    size = {"type": int, "default": 600, "metavar": "PIXELS", "help": "of each scene, the middle (default: %(default)s)"}
    arguments = options(__doc__, "+", study=studies, sigma=noise, light=light, size=size)
    levels = [*map(PaperProtocol, arguments.sigma), *map(SensorProtocol, arguments.light)]
    photographs: dict[str, Rows] = {}
    for source in arguments.scenes:
        try:
            kind, _, sides = source.partition(":")
            scene = load_scene(source) if kind != "spectral" else spectral_scene(*_sides(sides))
            scene = replace(scene, rgb=cut(scene.rgb, arguments.size))
        except InputError as error:
            raise SystemExit(f"{source}: {error}") from None
        drawn: dict[str, Rows] = {}
        for study in arguments.study:
            if (study == "bands") == (scene.channels == BANDS):
                rows = (drawn if study == "bands" else photographs).setdefault(study, {})
                for level in levels:
                    for name, figures in STUDIES[study][2](scene, level):
                        rows.setdefault((level.text, name), []).append(figures)
        print_tables(drawn, source)
    print_tables(photographs, "means over the photographs")


def print_tables(tables: dict[str, Rows], what: str) -> None:
    """Print the tables of some scenes in Markdown: means over them."""
    for study, rows in tables.items():
        title, measures, _ = STUDIES[study]
        print(f"\n### {title}: {what}\n\n| | | {' | '.join(measures)} |\n|{'---|' * (len(measures) + 2)}")
        for (level, name), found in rows.items():
            print(f"| {level} | {name} | {' | '.join(f'{figure:.3g}' for figure in np.mean(found, axis=0))} |")
        print(flush=True)


if __name__ == "__main__":
    main()
