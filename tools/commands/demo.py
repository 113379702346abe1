"""Run the whole chain on a built-in scene: simulate a shot, save it as DNG, read it, render it,
compare it with a Bayer camera.

Needs no input and no network. The folder then holds the shot, its preview, the render (preset
best), the truth, and two pictures that explain: overview.png shows how the camera works,
comparison.png how its picture compares.

With --burst it simulates a hand-held series instead, merges it, and compares the picture with that
of one frame.
"""

import argparse
import itertools
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...shared import CfaPattern, DoubleArray, FloatArray, Mosaic, read_dng, write_dng
from ...shared.dng import read_preview
from ...shared.series import frame_name
from ...shared.writing import durable_file, write_durably
from ..batch.console import Console
from ..batch.in_memory import camera_preview, merged_picture, renderings
from ..batch.jobs import Job, Outcome, output_folder, run_jobs
from ..evaluation.metrics import MEDIAN, quality
from ..evaluation.rivals.bilinear import demosaic_bilinear
from ..io.development import Development
from ..io.display import ColourTransform
from ..io.kind import PictureKind, write_picture
from ..io.scene import Scene
from ..simulation import simulated_camera
from ..simulation.bayer import sample_bayer
from ..simulation.drawn.builtin import builtin_scene
from ..simulation.protocols import PaperProtocol
from ..simulation.simulated_camera import SimulatedBurst, SimulatedCamera, SimulatedFrame
from .options import add

if TYPE_CHECKING:
    from PIL.Image import Image

_WIDTH, _HEIGHT, _SEED = 1200, 800, 0
_NOISE = PaperProtocol(0.01)
_FOLDER = "panchroma-demo"
_FRAMES, _MOTION = 8, (3.0, 0.3)  # of a burst; pixels and degrees
# The scene of a burst, and how many of its pixels, each way, are one of the sensor.
_DRAWN, _PIXEL = (1800, 1200), 2
_PICTURES = "shot.dng preview.jpg render.png render.tif truth.tif overview.png comparison.png"
_BURST_PICTURES = "frame.png burst.png burst.tif truth.tif comparison.png"
_MEASURED = PictureKind("tif", 32, "camera")
_BAYER, _PAPER, _BEST = "Bayer, bilinear", "Panchroma, paper", "Panchroma, best"
# Parts of the scene at its size above: (row, column) of the first pixel.
_OVERVIEW = (429, 132)
_CROPS = {"Siemens star": (604, 484), "fine strokes": (676, 944), "leaves": (150, 640)}
_BURST_CROPS = {"fine strokes": (484, 693), "equal luminance": (426, 588), "seeds": (152, 340)}

Crops = dict[str, tuple[int, int]]
"""Name of a part of the scene -> row and column of its first pixel."""
Medians = dict[str, DoubleArray]
"""Name of a method -> its median PSNR in RGB, luminance and chrominance, dB."""

USAGE = ""
EXAMPLE = "panchroma demo"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma demo`."""
    results = f"folder for the results (default: {_FOLDER}, or {_FOLDER}-2, ...)"
    add(parser, "output", required=False, help=results)
    burst = f"merge a hand-held series of {_FRAMES} frames"
    parser.add_argument("--burst", action="store_true", help=burst)


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write the results and show the comparison; returns the exit code."""
    names = (_FOLDER if number == 1 else f"{_FOLDER}-{number}" for number in itertools.count(1))
    unused = next(name for name in names if not Path(name).exists())
    folder = output_folder(unused if arguments.output is None else arguments.output)
    shots = [f"{frame_name('frame', number + 1, _FRAMES)}.dng" for number in range(_FRAMES)]
    results = [*_BURST_PICTURES.split(), *shots] if arguments.burst else _PICTURES.split()
    show = partial(_show_burst, shots) if arguments.burst else _show_shot

    def work(job: Job, _: object) -> Outcome:
        title = f"Median PSNR over all 10 x 10 patches, dB, at sigma {_NOISE.level:g}"
        lines = [title, f"{'':18}{'RGB':>8}{'luminance':>12}{'chrominance':>13}"]
        for name, (rgb, luminance, chrominance) in show(folder, console).items():
            lines.append(f"{name:18}{rgb:8.1f}{luminance:12.1f}{chrominance:13.1f}")
        return Outcome(lines=(*lines, f"{folder}: {', '.join(results)}"))

    return run_jobs([Job("demo", tuple(folder / name for name in results))], work, console)


def _show_shot(folder: Path, console: Console) -> Medians:
    """Run the chain for one shot, and write its pictures."""
    from ..io.illustrations import overview

    scene = builtin_scene(_WIDTH, _HEIGHT)
    mosaic = _photographed(scene, SimulatedFrame(scene.rgb), folder / "shot.dng", _SEED)
    preview = folder / "preview.jpg"
    write_durably(preview, read_preview(folder / "shot.dng"))
    console.note(f"the camera's own preview is ready: {preview}")
    with console.progress("demo") as progress:
        paper, best = renderings(mosaic, progress, "paper", "best")
    shot = _NOISE.bayer(sample_bayer(scene.rgb), np.random.default_rng(_SEED))
    bayer = demosaic_bilinear(shot.samples)
    _save(folder, mosaic, {"render.png": best.rgb, "render.tif": best.rgb, "truth.tif": scene.rgb})
    _draw(folder / "overview.png", overview(mosaic, best.luminance, best.rgb, _OVERVIEW))
    compared = {_BAYER: bayer, _PAPER: paper.rgb, _BEST: best.rgb}
    _compare(folder, mosaic, {"truth": scene.rgb, _BAYER: bayer, _BEST: best.rgb}, _CROPS)
    return {name: quality(rgb, scene.rgb)[:, MEDIAN] for name, rgb in compared.items()}


def _show_burst(names: list[str], folder: Path, console: Console) -> Medians:
    """Simulate a burst, merge it, and write its pictures and the shots of these names."""
    scene = builtin_scene(*_DRAWN)
    burst, hand = SimulatedBurst(len(names), *_MOTION), np.random.default_rng(_SEED)
    frames = list(simulated_camera.burst_frames(scene.rgb, burst, hand, _PIXEL))
    paths = [folder / name for name in names]
    shots = enumerate(zip(frames, paths, strict=True))
    mosaics = [_photographed(scene, *shot, seed) for seed, shot in shots]
    with console.progress("demo") as progress:
        one = renderings(mosaics[0], progress, "best")[0].rgb
        merged, _ = merged_picture([*map(str, paths)], progress, read_dng, None, reference=0)
    truth, compared = frames[0].rgb, {"One frame": one, f"Burst of {len(names)} frames": merged}
    pictures = {"frame.png": one, "burst.png": merged, "burst.tif": merged, "truth.tif": truth}
    _save(folder, mosaics[0], pictures)
    _compare(folder, mosaics[0], {"truth": truth, **compared}, _BURST_CROPS)
    return {name: quality(rgb, truth)[:, MEDIAN] for name, rgb in compared.items()}


def _photographed(scene: Scene, frame: SimulatedFrame, path: Path, seed: int) -> Mosaic:
    """A shot of a frame, as its file holds it."""
    camera = SimulatedCamera(CfaPattern.bayer(), protocol=_NOISE)
    mosaic = camera.shoot(scene, np.random.default_rng(seed), frame).mosaic
    write_dng(path, mosaic, camera_preview(mosaic))
    return read_dng(path)


def _save(folder: Path, mosaic: Mosaic, pictures: dict[str, FloatArray]) -> None:
    """Write pictures of a shot by the names of their files: PNG for people, TIFF as measured."""
    for name, rgb in pictures.items():
        kind = PictureKind.of("png") if name.endswith(".png") else _MEASURED
        development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata)
        write_picture(folder / name, [rgb], development)


def _compare(folder: Path, mosaic: Mosaic, pictures: dict[str, FloatArray], crops: Crops) -> None:
    from ..io.illustrations import comparison

    transform = ColourTransform.to_space(mosaic.calibration)
    displayed = {name: transform.apply(rgb) for name, rgb in pictures.items()}
    _draw(folder / "comparison.png", comparison(displayed, crops))


def _draw(path: Path, figure: "Image") -> None:
    with durable_file(path) as file:
        figure.save(file, "PNG", optimize=True)
