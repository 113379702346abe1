"""Run the whole chain on the built-in scene: simulate a shot, save it as DNG, read it back, render it, compare it with Bayer.

Nothing is needed and nothing is downloaded. The folder then holds the shot, its preview, the render, the truth and two pictures
that explain: overview.png (what the camera is) and comparison.png.
"""

import argparse
from collections.abc import Sequence
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration, read_dng, write_dng
from shared.display import ColourTransform
from shared.dng import read_preview
from shared.errors import InputError, OutputError
from shared.sensor import simulate_additive
from shared.writing import write_durably
from tools.evaluation.metrics import Quality, quality
from tools.evaluation.rivals.bayer import bayer_mosaic
from tools.evaluation.rivals.bilinear import demosaic_bilinear
from tools.host.compilation import telling_compilation
from tools.host.console import Console
from tools.host.jobs import Job, output_folder, run_jobs
from tools.pictures.previews import Previews
from tools.pictures.writer import PictureKind, write_picture
from tools.scenes.drawn.builtin import builtin_scene
from tools.scenes.scene import Scene

_WIDTH, _HEIGHT, _BITS, _SEED = 1200, 800, 12, 0
_FOLDER = "panchroma-demo"
_RESULTS = ("shot.dng", "preview.jpg", "render.png", "render.tif", "truth.tif", "overview.png", "comparison.png")
_MEASURED = PictureKind("tif", 32, "camera")
# Parts of the scene at its size above: (row, column) of the first pixel.
_OVERVIEW = (120, 330)
_CROPS = {"Siemens star": (604, 484), "fine strokes": (676, 944), "leaves": (150, 640)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma demo`."""
    parser.add_argument("-o", "--output", metavar="DIR", help=f"folder for the results (default: {_FOLDER}, numbered)")
    parser.add_argument("--sigma", type=float, default=0.01, help="standard deviation of the noise, scene units")
    parser.add_argument("--overwrite", action="store_true", help="replace results that exist")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    sigma: float = arguments.sigma
    if not 0 <= sigma < np.inf:
        raise InputError(f"--sigma is {sigma}, expected 0 or more")
    folder = _folder(arguments.output)

    def work(job: Job) -> dict[str, Any]:
        _demonstrate(job.outputs, sigma, console, overwrite=arguments.overwrite)
        console.say(f"{folder}: {', '.join(_RESULTS)}")
        return {}

    job = Job("demo", tuple(folder / name for name in _RESULTS))
    return run_jobs([job], work, console, overwrite=arguments.overwrite)


def _demonstrate(results: Sequence[Path], sigma: float, console: Console, *, overwrite: bool) -> None:
    """The whole chain, and the table; writes `results`, in the order of _RESULTS."""
    shot, preview, render_png, render_tif, truth_tif, overview_png, comparison_png = results
    scene = builtin_scene(_WIDTH, _HEIGHT)
    taken = _photograph(scene, sigma)
    write_dng(shot, taken, Previews()(taken), overwrite=overwrite)
    write_durably(preview, read_preview(shot), overwrite=overwrite)
    mosaic = read_dng(shot)  # from here on only what the file holds

    from offline import PAPER, render
    from tools.pictures.illustrations import comparison, overview

    with console.progress("demo") as progress, telling_compilation(console.note, progress):
        rendering = render(mosaic, PAPER, progress)
    bayer = demosaic_bilinear(bayer_mosaic(scene.rgb, sigma, np.random.default_rng(_SEED)))
    pictures = {"truth": scene.rgb, "Bayer, bilinear": bayer, "Panchroma": rendering.rgb}
    for path, rgb, kind in (
        (render_png, rendering.rgb, PictureKind.of("png")),
        (render_tif, rendering.rgb, _MEASURED),
        (truth_tif, scene.rgb, _MEASURED),
    ):
        write_picture(path, rgb, kind, calibration=mosaic.calibration, metadata=mosaic.metadata, overwrite=overwrite)
    shown = ColourTransform.to_space(mosaic.calibration)
    displayed = {name: shown.apply(rgb) for name, rgb in pictures.items()}
    for path, figure in (
        (overview_png, overview(mosaic, rendering, _OVERVIEW)),
        (comparison_png, comparison(displayed, _CROPS)),
    ):
        buffer = BytesIO()
        figure.save(buffer, "PNG", optimize=True)
        write_durably(path, buffer.getvalue(), overwrite=overwrite)
    console.say(_table({name: quality(rgb, scene.rgb) for name, rgb in pictures.items() if name != "truth"}, sigma))


def _folder(given: str | None) -> Path:
    """The folder asked for, or the first of the numbered ones that is free; made if missing."""
    if given is None:
        names = (_FOLDER if number == 1 else f"{_FOLDER}-{number}" for number in count(1))
        given = next(name for name in names if not Path(name).exists())
    try:
        if given:
            Path(given).mkdir(exist_ok=True)
    except FileExistsError:
        pass  # it is a file: `output_folder` says so
    except OSError as error:
        raise OutputError(f"{given}: the folder cannot be made ({error.strerror or error}); choose another with -o") from None
    return output_folder(given)


def _photograph(scene: Scene, sigma: float) -> Mosaic:
    camera = SensorCalibration.of_bits(_BITS, camera_to_xyz=scene.camera_to_xyz, neutral=scene.neutral, sensor="simulated")
    rng = np.random.default_rng(_SEED)
    return simulate_additive(scene.rgb, CfaPattern.bayer(), camera, sigma, rng, scene.metadata)


def _table(qualities: dict[str, Quality], sigma: float) -> str:
    """Median PSNR per method."""
    lines = [
        f"Median PSNR over all 10 x 10 patches, dB, at sigma {sigma:g}",
        f"{'':18}{'RGB':>8}{'luminance':>12}{'chrominance':>13}",
    ]
    for name, each in qualities.items():
        rgb, luminance, chrominance = each.median
        lines.append(f"{name:18}{rgb:8.1f}{luminance:12.1f}{chrominance:13.1f}")
    return "\n".join(lines)
