"""Render shots at full quality.

With --bits 32 --space camera the result is float32 in scene units, unclipped: it can be subtracted from a truth of `simulate`.
Everything else is for looking at: white-balanced, with an ICC profile and the capture data.
"""

import argparse
import time
from pathlib import Path
from typing import Any

from shared import Mosaic, read_camera, read_dng
from shared.errors import InputError

from .console import Console
from .picture_writer import POSSIBLE, PictureKind, check_gain, check_output, write_picture
from .work import Job, add_limit, output_folder, plan, run_jobs

_PRESETS = ("best", "paper")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma render`."""
    parser.add_argument("shots", nargs="+", metavar="SHOT", help="a DNG of Panchroma")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="existing folder for STEM.EXT")
    parser.add_argument("-f", "--format", choices=tuple(POSSIBLE), default="tif", help="dng: linear, for a raw developer to finish")
    parser.add_argument("--bits", type=int, choices=(8, 16, 32), help="per sample (default: the format's)")
    spaces = tuple(dict.fromkeys(space for possible in POSSIBLE.values() for space in possible))
    parser.add_argument("--space", choices=spaces, help="colours (default: the format's; camera: scene units as measured)")
    parser.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="gain of a display picture")
    parser.add_argument("--camera", metavar="FILE", help="camera.json to use instead of the calibration in the shots")
    parser.add_argument("--preset", choices=_PRESETS, default=_PRESETS[0], help="paper: the published method, literally")
    add_limit(parser)
    parser.add_argument("--overwrite", action="store_true", help="replace results that exist")
    parser.add_argument("--dry-run", action="store_true", help="only say what would be done")
    parser.add_argument("--json", action="store_true", help="one object per shot on stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space)
    check_gain(kind, arguments.exposure)
    folder = output_folder(arguments.output)
    camera = read_camera(arguments.camera) if arguments.camera else None

    def names(source: str) -> list[str]:
        return [Path(source).stem + kind.suffix]

    def work(job: Job) -> dict[str, Any]:
        (output,) = job.outputs
        mosaic = read_dng(job.source, max_pixels=arguments.max_pixels)
        if camera is not None:
            mosaic = camera.calibrated(mosaic)
        check_output(kind, mosaic.calibration, mosaic.shape)
        check_light(mosaic)
        if arguments.dry_run:
            console.say(f"{job.source} -> {output}")
            return {"output": str(output), "dry_run": True}
        if mosaic.calibration.noise is None:
            console.note(f"{job.source}: the noise is unknown and taken for none; calibrate the camera for better colour")
        start = time.monotonic()
        _render_to(output, mosaic, kind, arguments, job.source, console)
        seconds = time.monotonic() - start
        rows, columns = mosaic.shape
        console.say(f"{output}: {columns} x {rows}, {kind.bits} bits, {kind.space}, {seconds:.1f} s")
        return {"output": str(output), "width": columns, "height": rows, "seconds": round(seconds, 3)}

    return run_jobs(plan(arguments.shots, names, folder), work, console, overwrite=arguments.overwrite)


def check_light(mosaic: Mosaic) -> None:
    """Raise InputError for a frame that holds no picture: all black, or all saturated."""
    measured = mosaic.signal[mosaic.pattern.panchromatic_mask(mosaic.shape)]
    if measured.size and measured.max() <= 0:
        raise InputError("no sample is above the black level: nothing was exposed, or the calibration's black level is too high")
    if measured.size and measured.min() >= mosaic.calibration.full_scale:
        raise InputError("every panchromatic sample is saturated: there is no picture in it; expose less")


def _render_to(
    output: Path, mosaic: Mosaic, kind: PictureKind, arguments: argparse.Namespace, title: str, console: Console
) -> None:
    from offline import BEST, PAPER, render

    with console.progress(title) as progress:
        rendering = render(mosaic, PAPER if arguments.preset == "paper" else BEST, progress)
        progress.stage("writing", 1)
        write_picture(
            output,
            rendering.rgb,
            kind,
            calibration=mosaic.calibration,
            metadata=mosaic.metadata,
            exposure=arguments.exposure,
            overwrite=arguments.overwrite,
        )
