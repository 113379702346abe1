"""Run the whole chain on a built-in scene: simulate a shot, save it as DNG, read it, render it, compare it with a Bayer camera.

Needs no input and no network. The folder then holds the shot, its preview, the render (preset best), the truth, and two pictures
that explain: overview.png shows how the camera works, comparison.png how its picture compares.

With --burst it simulates a hand-held series instead, merges it, and compares the picture with that of one frame.
"""

import argparse
import itertools
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...shared import CfaPattern, Mosaic, read_dng, write_dng
from ...shared.arrays import FloatArray
from ...shared.dng import read_preview
from ...shared.series import frame_name
from ...shared.writing import write_durably
from ..batch.console import Console
from ..batch.in_memory import merged_picture, renderings
from ..batch.jobs import Job, Outcome, output_folder, run_jobs
from ..batch.previews import Previews
from ..batch.progress import StageProgress
from ..evaluation.metrics import quality
from ..evaluation.rivals.bilinear import demosaic_bilinear
from ..io.development import Development, write_picture
from ..io.display import ColourTransform
from ..io.kind import PictureKind
from ..io.scene import Scene
from ..simulation.bayer import sample_bayer
from ..simulation.burst import SimulatedBurst, SimulatedFrame, burst_frames
from ..simulation.drawn.builtin import builtin_scene
from ..simulation.noise import PaperProtocol
from ..simulation.simulated_camera import SimulatedCamera
from .options import add

if TYPE_CHECKING:
    from PIL.Image import Image

_WIDTH, _HEIGHT, _SEED = 1200, 800, 0
_NOISE = PaperProtocol(0.01)
_FOLDER = "panchroma-demo"
_FRAMES, _MOTION = 8, (3.0, 0.3)  # of a burst; pixels and degrees
_DRAWN, _PIXEL = (1800, 1200), 2  # the scene of a burst, and how many of its pixels, each way, are one of the sensor
_RESULTS: tuple[str, ...] = ("shot.dng", "preview.jpg", "render.png", "render.tif", "truth.tif", "overview.png", "comparison.png")
_BURST_RESULTS = ("frame.png", "burst.png", "burst.tif", "truth.tif", "comparison.png")
_MEASURED = PictureKind("tif", 32, "camera")
_TRUTH, _BAYER, _PAPER, _BEST, _ONE = "truth", "Bayer, bilinear", "Panchroma, paper", "Panchroma, best", "One frame"
# Parts of the scene at its size above: (row, column) of the first pixel.
_OVERVIEW = (429, 132)
_CROPS = {"Siemens star": (604, 484), "fine strokes": (676, 944), "leaves": (150, 640)}
_BURST_CROPS = {"fine strokes": (484, 693), "equal luminance": (426, 588), "seeds": (152, 340)}

USAGE = ""
EXAMPLE = "panchroma demo"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma demo`."""
    results = f"folder for the results (default: {_FOLDER}, or {_FOLDER}-2, ...)"
    add(parser, "output", required=False, help=results)
    parser.add_argument("--burst", action="store_true", help=f"merge a hand-held series of {_FRAMES} frames")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write the results and show the comparison; returns the exit code."""
    frames = _FRAMES if arguments.burst else 0
    shots = [f"{frame_name('frame', number + 1, frames)}.dng" for number in range(frames)]
    results = (*_BURST_RESULTS, *shots) if shots else _RESULTS
    names = (_FOLDER if number == 1 else f"{_FOLDER}-{number}" for number in itertools.count(1))
    unused = next(name for name in names if not Path(name).exists())
    folder = output_folder(unused if arguments.output is None else arguments.output)
    demo = _Demo(folder, console)

    def work(job: Job, listener: StageProgress) -> Outcome:
        return Outcome(lines=(*(demo.burst(shots) if shots else demo.shot()), f"{folder}: {', '.join(results)}"))

    job = Job("demo", tuple(folder / name for name in results))
    return run_jobs([job], work, console)


@dataclass(frozen=True)
class _Demo:
    """The chain from a scene to files in a folder, and to a table."""

    folder: Path
    console: Console

    def shot(self) -> list[str]:
        """Run the chain for one shot, write _RESULTS, and return the table."""
        scene = builtin_scene(_WIDTH, _HEIGHT)
        mosaic = self._photographed(scene, SimulatedFrame(scene.rgb), "shot.dng", _SEED)
        preview = self.folder / "preview.jpg"
        write_durably(preview, read_preview(self.folder / "shot.dng"))
        self.console.note(f"the camera's own preview is ready: {preview}")

        from ..io.illustrations import overview

        with self.console.progress("demo") as progress:
            paper, best = renderings(mosaic, ("paper", "best"), progress)
        bayer = demosaic_bilinear(_NOISE.bayer(sample_bayer(scene.rgb), np.random.default_rng(_SEED)).samples)
        self._save(mosaic, {"render.png": best.rgb, "render.tif": best.rgb, "truth.tif": scene.rgb})
        self._draw("overview.png", overview(mosaic, best.luminance, best.rgb, _OVERVIEW))
        self._compare(mosaic, {_TRUTH: scene.rgb, _BAYER: bayer, _BEST: best.rgb}, _CROPS)
        compared = {_BAYER: bayer, _PAPER: paper.rgb, _BEST: best.rgb}
        return self._table({name: quality(rgb, scene.rgb).median for name, rgb in compared.items()})

    def burst(self, names: list[str]) -> list[str]:
        """Simulate a burst, merge it, write _BURST_RESULTS and the shots of these names, and return the table."""
        scene = builtin_scene(*_DRAWN)
        frames = list(burst_frames(scene.rgb, SimulatedBurst(len(names), *_MOTION), np.random.default_rng(_SEED), _PIXEL))
        truth = frames[0].rgb
        mosaics = [self._photographed(scene, *each, number) for number, each in enumerate(zip(frames, names, strict=True))]

        with self.console.progress("demo") as progress:
            one = renderings(mosaics[0], ("best",), progress)[0].rgb
            rgb = merged_picture(mosaics, progress)
        self._save(mosaics[0], {"frame.png": one, "burst.png": rgb, "burst.tif": rgb, "truth.tif": truth})
        compared = {_ONE: one, f"Burst of {len(names)} frames": rgb}
        self._compare(mosaics[0], {_TRUTH: truth, **compared}, _BURST_CROPS)
        medians = {title: quality(picture, truth).median for title, picture in compared.items()}
        gain = tuple(after - before for before, after in zip(*medians.values(), strict=True))
        return self._table(medians | {"Gain": gain})

    def _photographed(self, scene: Scene, frame: SimulatedFrame, name: str, seed: int) -> Mosaic:
        """A shot of a frame, as its file holds it."""
        camera = SimulatedCamera.of(CfaPattern.bayer(), protocol=_NOISE)
        mosaic, path = camera.shoot(scene, np.random.default_rng(seed), frame).mosaic, self.folder / name
        write_dng(path, mosaic, Previews()(mosaic))
        return read_dng(path)

    def _save(self, mosaic: Mosaic, pictures: dict[str, FloatArray]) -> None:
        """Write pictures of a shot by the names of their files: PNG for people, TIFF as measured."""
        for name, rgb in pictures.items():
            kind = PictureKind.of("png") if name.endswith(".png") else _MEASURED
            development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata)
            write_picture(self.folder / name, [rgb], development)

    def _compare(self, mosaic: Mosaic, pictures: dict[str, FloatArray], crops: dict[str, tuple[int, int]]) -> None:
        from ..io.illustrations import comparison

        shown = ColourTransform.to_space(mosaic.calibration)
        self._draw("comparison.png", comparison({name: shown.apply(rgb) for name, rgb in pictures.items()}, crops))

    def _draw(self, name: str, figure: "Image") -> None:
        buffer = BytesIO()
        figure.save(buffer, "PNG", optimize=True)
        write_durably(self.folder / name, buffer.getvalue())

    def _table(self, medians: dict[str, tuple[float, ...]]) -> list[str]:
        """Median PSNR of each method."""
        lines = [
            f"Median PSNR over all 10 x 10 patches, dB, at sigma {_NOISE.level:g}",
            f"{'':18}{'RGB':>8}{'luminance':>12}{'chrominance':>13}",
        ]
        return lines + [f"{name:18}{rgb:8.1f}{light:12.1f}{colour:13.1f}" for name, (rgb, light, colour) in medians.items()]
