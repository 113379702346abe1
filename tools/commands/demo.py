"""Run the whole chain on a built-in scene: simulate a shot, save it as DNG, read it, render it, compare it with a Bayer camera.

Needs no input and no network. The folder then holds the shot, its preview, the render (preset best), the truth, and two pictures
that explain: overview.png shows how the camera works, comparison.png how its picture compares.

With --burst it simulates a hand-held series instead, merges it, and compares the picture with that of one frame.
"""

import argparse
import itertools
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shared import CfaPattern, Mosaic, read_dng, write_dng
from shared.display import ColourTransform
from shared.dng import read_preview
from shared.errors import InputError
from shared.series import frame_name
from shared.writing import write_durably
from tools.camera.bayer import sample_bayer
from tools.camera.burst import SimulatedBurst, SimulatedFrame, burst_frames
from tools.camera.protocols import PaperProtocol
from tools.camera.simulated_camera import SimulatedCamera
from tools.evaluation.metrics import quality
from tools.evaluation.rivals.bilinear import demosaic_bilinear
from tools.host.console import Console
from tools.host.jobs import Job, Outcome, output_folder, run_jobs
from tools.host.processors import processors
from tools.host.progress import StageProgress
from tools.pictures.development import Development
from tools.pictures.kind import PictureKind
from tools.pictures.previews import Previews
from tools.pictures.writing import write_picture
from tools.rendering.compilation import announced_compilation, compile_ahead
from tools.scenes.drawn.builtin import builtin_scene
from tools.scenes.scene import Scene

from .options import add, count, factor

if TYPE_CHECKING:
    from PIL.Image import Image

_WIDTH, _HEIGHT, _SEED = 1200, 800, 0
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma demo`."""
    parser.add_argument("-o", "--output", metavar="DIR", help=f"folder for the results (default: {_FOLDER}, or {_FOLDER}-2, ...)")
    parser.add_argument("--sigma", type=factor, default=0.01, help="standard deviation of the noise, scene units")
    parser.add_argument(
        "--burst",
        type=count,
        nargs="?",
        const=_FRAMES,
        metavar="N",
        help=f"merge a hand-held series of N frames (without N: {_FRAMES})",
    )
    add(parser, "overwrite")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write the results and show the comparison; returns the exit code."""
    sigma: float = arguments.sigma
    frames: int | None = arguments.burst
    if frames is not None and frames < 2:
        raise InputError(f"--burst is {frames}, expected 2 frames or more")
    results = (
        _RESULTS if frames is None else (*_BURST_RESULTS, *(f"{frame_name('frame', n + 1, frames)}.dng" for n in range(frames)))
    )
    names = (_FOLDER if number == 1 else f"{_FOLDER}-{number}" for number in itertools.count(1))
    unused = next(name for name in names if not Path(name).exists())
    folder = output_folder(unused if arguments.output is None else arguments.output)

    def work(job: Job, listener: StageProgress) -> Outcome:
        (_demonstrate if frames is None else _demonstrate_burst)(job.outputs, sigma, console, overwrite=arguments.overwrite)
        return Outcome(lines=(f"{folder}: {', '.join(results)}",))

    job = Job("demo", tuple(folder / name for name in results))
    return run_jobs([job], work, console, overwrite=arguments.overwrite)


def _demonstrate(results: Sequence[Path], sigma: float, console: Console, *, overwrite: bool) -> None:
    """Run the chain, write `results` (in the order of _RESULTS) and show the table."""
    shot, preview, render_png, render_tif, truth_tif, overview_png, comparison_png = results
    scene = builtin_scene(_WIDTH, _HEIGHT)
    taken = _photograph(scene, None, sigma, _SEED)
    write_dng(shot, taken, Previews()(taken), overwrite=overwrite)
    write_durably(preview, read_preview(shot), overwrite=overwrite)
    mosaic = read_dng(shot)  # from here on only what the file holds

    from offline import BEST, PAPER, render
    from tools.pictures.illustrations import comparison, overview

    with console.progress("demo") as progress, announced_compilation(progress):
        compile_ahead([PAPER, BEST], processors(), progress)
        paper, best = render(mosaic, PAPER, progress), render(mosaic, BEST, progress)
    bayer = demosaic_bilinear(PaperProtocol(sigma).bayer(sample_bayer(scene.rgb), np.random.default_rng(_SEED)).samples)
    for path, rgb, kind in (
        (render_png, best.rgb, PictureKind.of("png")),
        (render_tif, best.rgb, _MEASURED),
        (truth_tif, scene.rgb, _MEASURED),
    ):
        development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata)
        write_picture(path, [rgb], development, overwrite=overwrite)
    shown = ColourTransform.to_space(mosaic.calibration)
    displayed = {name: shown.apply(rgb) for name, rgb in ((_TRUTH, scene.rgb), (_BAYER, bayer), (_BEST, best.rgb))}
    drawn = overview(mosaic, best.luminance, best.rgb, _OVERVIEW), comparison(displayed, _CROPS)
    for path, figure in zip((overview_png, comparison_png), drawn, strict=True):
        _write_figure(path, figure, overwrite=overwrite)
    compared = {_BAYER: bayer, _PAPER: paper.rgb, _BEST: best.rgb}
    console.say(*_table({name: quality(rgb, scene.rgb).median for name, rgb in compared.items()}, sigma))


def _demonstrate_burst(results: Sequence[Path], sigma: float, console: Console, *, overwrite: bool) -> None:
    """Simulate a burst, merge it, write `results` (in the order of _BURST_RESULTS, then the frames) and show the table."""
    frame_png, burst_png, burst_tif, truth_tif, comparison_png, *shots = results
    scene, previews = builtin_scene(*_DRAWN), Previews()
    burst = burst_frames(scene.rgb, SimulatedBurst(len(shots), *_MOTION), np.random.default_rng(_SEED), _PIXEL)
    frames = list(burst)
    truth = frames[0].rgb
    for number, (shot, frame) in enumerate(zip(shots, frames, strict=True)):
        mosaic = _photograph(scene, frame, sigma, number)
        write_dng(shot, mosaic, previews(mosaic), overwrite=overwrite)
    mosaics = [read_dng(shot) for shot in shots]

    from offline import BEST, render
    from offline.burst import merge_burst, render_burst_bands
    from tools.pictures.illustrations import comparison

    with console.progress("demo") as progress, announced_compilation(progress):
        compile_ahead([BEST], processors(), progress)
        one = render(mosaics[0], BEST, progress).rgb
        merged = merge_burst(mosaics, BEST, progress, reference=0)
        rgb = np.concatenate(list(render_burst_bands(merged, BEST, progress)))
    for path, picture, kind in (
        (frame_png, one, PictureKind.of("png")),
        (burst_png, rgb, PictureKind.of("png")),
        (burst_tif, rgb, _MEASURED),
        (truth_tif, truth, _MEASURED),
    ):
        development = Development(kind, mosaics[0].shape, mosaics[0].calibration, mosaics[0].metadata)
        write_picture(path, [picture], development, overwrite=overwrite)
    shown = ColourTransform.to_space(mosaics[0].calibration)
    name = f"Burst of {len(shots)} frames"
    displayed = {title: shown.apply(picture) for title, picture in ((_TRUTH, truth), (_ONE, one), (name, rgb))}
    _write_figure(comparison_png, comparison(displayed, _BURST_CROPS), overwrite=overwrite)
    medians = {title: quality(picture, truth).median for title, picture in ((_ONE, one), (name, rgb))}
    gain = tuple(after - before for before, after in zip(*medians.values(), strict=True))
    console.say(*_table(medians | {"Gain": gain}, sigma))


def _write_figure(path: Path, figure: "Image", *, overwrite: bool) -> None:
    buffer = BytesIO()
    figure.save(buffer, "PNG", optimize=True)
    write_durably(path, buffer.getvalue(), overwrite=overwrite)


def _photograph(scene: Scene, frame: SimulatedFrame | None, sigma: float, seed: int) -> Mosaic:
    """A shot of a scene, or of one frame of a burst of it."""
    camera = SimulatedCamera.of(CfaPattern.bayer(), protocol=PaperProtocol(sigma))
    return camera.shoot(scene, np.random.default_rng(seed), frame).mosaic


def _table(medians: dict[str, tuple[float, float, float]], sigma: float) -> list[str]:
    """Median PSNR of each method."""
    lines = [
        f"Median PSNR over all 10 x 10 patches, dB, at sigma {sigma:g}",
        f"{'':18}{'RGB':>8}{'luminance':>12}{'chrominance':>13}",
    ]
    return lines + [f"{name:18}{rgb:8.1f}{light:12.1f}{colour:13.1f}" for name, (rgb, light, colour) in medians.items()]
