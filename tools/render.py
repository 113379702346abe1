"""Render shots at full quality.

With --bits 32 --space camera the result is float32 in scene units, unclipped: it can be subtracted from a truth of `simulate`.
Everything else is for looking at: white-balanced, with an ICC profile and the capture data.
"""

import argparse
import time
from pathlib import Path
from typing import Any

from shared import Mosaic, read_camera, read_dng
from shared.arrays import strips
from shared.errors import InputError

from .console import Console
from .defect_list import read_defects, with_defects
from .memory import allowed_memory
from .picture_writer import POSSIBLE, PictureKind, check_gain, check_output
from .rendering import check_memory, render_to, telling_compilation
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
    parser.add_argument("--defects", metavar="FILE", help="more defective pixels: lines of row, column (from 0), or JSON")
    parser.add_argument("--preset", choices=_PRESETS, default=_PRESETS[0], help="paper: the published method, literally")
    parser.add_argument("-j", "--jobs", dest="threads", type=int, metavar="N", help="threads (default, and most: one per core)")
    parser.add_argument("--max-memory", metavar="SIZE", help="for example 4G (default: most of what is free)")
    add_limit(parser)
    parser.add_argument("--overwrite", action="store_true", help="replace results that exist")
    parser.add_argument("--dry-run", action="store_true", help="only say what would be done")
    parser.add_argument("--json", action="store_true", help="one object per shot on stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space)
    check_gain(kind, arguments.exposure)
    allowed_memory(arguments.max_memory)  # the free memory is looked up for each shot
    folder = output_folder(arguments.output)
    camera = read_camera(arguments.camera) if arguments.camera else None
    if arguments.defects and arguments.preset == "paper":
        raise InputError("--defects needs --preset best: the published method takes every sample for good")
    defects = read_defects(arguments.defects) if arguments.defects else ()

    def names(source: str) -> list[str]:
        return [Path(source).stem + kind.suffix]

    def read(source: str) -> Mosaic:
        mosaic = read_dng(source, max_pixels=arguments.max_pixels)
        if camera is not None:
            mosaic = camera.calibrated(mosaic)
        mosaic = with_defects(mosaic, defects)
        check_output(kind, mosaic.calibration, mosaic.shape)
        check_light(mosaic)
        return mosaic

    def work(job: Job) -> dict[str, Any]:
        (output,) = job.outputs
        if arguments.dry_run:
            read(job.source)
            console.say(f"{job.source} -> {output}")
            return {"output": str(output), "dry_run": True}
        from offline import BEST, PAPER

        start = time.monotonic()
        limit = allowed_memory(arguments.max_memory)
        settings = PAPER if arguments.preset == "paper" else BEST
        with console.progress(job.source) as progress, telling_compilation(console, progress):
            progress.stage("reading", 1)
            mosaic = read(job.source)
            if mosaic.calibration.noise is None:
                taken = "estimated from the shot" if settings.noise.estimate else "taken for none"
                console.note(f"{job.source}: the noise is unknown and {taken}; calibrate the camera for better colour")
            check_memory(mosaic, kind, settings, limit)
            render_to(output, mosaic, kind, settings, progress, exposure=arguments.exposure, overwrite=arguments.overwrite)
        seconds = time.monotonic() - start
        rows, columns = mosaic.shape
        console.say(f"{output}: {columns} x {rows}, {kind.bits} bits, {kind.space}, {seconds:.1f} s")
        return {"output": str(output), "width": columns, "height": rows, "seconds": round(seconds, 3)}

    return run_jobs(plan(arguments.shots, names, folder), work, console, overwrite=arguments.overwrite)


def check_light(mosaic: Mosaic) -> None:
    """Raise InputError for a frame that holds no picture: all black, or all saturated."""
    panchromatic, (height, width) = len(mosaic.pattern.channels), mosaic.shape
    lowest, highest = [], []
    for rows in strips(height):
        planes = mosaic.pattern.filter_map((rows.stop - rows.start, width), (rows.start, 0))
        measured = mosaic.signal[rows][planes == panchromatic]
        if measured.size:
            lowest.append(measured.min())
            highest.append(measured.max())
    if highest and max(highest) <= 0:
        raise InputError("no sample is above the black level: nothing was exposed, or the calibration's black level is too high")
    if lowest and min(lowest) >= mosaic.calibration.full_scale:
        raise InputError("every panchromatic sample is saturated: there is no picture in it; expose less")
