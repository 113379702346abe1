"""Merge a series of one scene, hand-held or from a sensor that moves by known steps, into one picture.

The frames are those of one `capture --burst` or `simulate --burst`, in a folder, or any shots of one camera that are named. The
first of those that are as sharp as any is the reference, whose view and capture data the picture has. Frames are aligned, and
merged where they agree with the reference; what has moved is the reference's alone. A frame that does not fit, or is a copy of
another one, is left out, and named. The picture is called STEM.EXT for frames STEM-1.dng, STEM-2.dng ..., otherwise as the first
file.
"""

import argparse

from shared import read_dng
from shared.errors import InputError
from tools.batch.burst import BurstOrder
from tools.batch.burst_files import series, series_stem
from tools.batch.compilation import limit_threads
from tools.batch.console import Console
from tools.batch.folders import DNGS, search
from tools.batch.jobs import FAILED, Job, do_jobs, identity, possible_jobs
from tools.batch.memory import share_one_heap
from tools.batch.progress import StageProgress
from tools.batch.run import passes

from .options import add, numbers, option
from .picture_options import add_picture, add_run, order_fields


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma burst`."""
    option(parser, "SHOT ...", "the DNGs of one series, or a folder with them in it or below", dest="shots")
    add(parser, "output", files="STEM.EXT")
    option(parser, "--reference SHOT", "the frame that the picture shows (default: the first of the sharpest)")
    option(
        parser,
        "--shifts X,Y ...",
        "pixel shift: where the sensor was at each shot, in its pixels, columns to the right and rows down; nothing is "
        "aligned then, and the reference is the first shot by default",
        type=numbers(2, "2,-0.5"),
    )
    add_picture(parser, "best", "unlearned")
    add_run(parser)
    add(parser, "json", each="picture")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Make the picture; returns the exit code."""
    share_one_heap()
    limit_threads(arguments.threads)
    fields = order_fields(arguments)
    folder, suffix = fields["folder"], fields["kind"].suffix
    found = search(arguments.shots, DNGS, output=folder)
    if not found.report(console):
        return FAILED
    names = series(found.sources)
    if len(names) < 2:
        read_dng(names[0], max_pixels=arguments.max_pixels)  # says what is wrong with it
        raise InputError(f"{names[0]}: is one frame, expected two or more of one scene; panchroma render renders a shot")
    shifts = tuple(arguments.shifts)
    if shifts and len(shifts) != len(names):
        raise InputError(
            f"--shifts has {len(shifts)} places for {len(names)} shots, expected one for each, such as 0,0 2,0 0,2 2,2"
        )
    reference = None
    if arguments.reference is not None:
        wanted = identity(arguments.reference) or arguments.reference
        reference = next((index for index, name in enumerate(names) if (identity(name) or name) == wanted), None)
        if reference is None:
            raise InputError(f"--reference {arguments.reference}: is none of the {len(names)} shots of the burst")
    order = BurstOrder(reference=reference, shifts=shifts, **fields)
    job = Job(names[0], (folder / f"{series_stem(names)}{suffix}",), all(each.found for each in found.sources), tuple(names))
    jobs, possible = possible_jobs([job], console, overwrite=order.overwrite or order.resume)
    through = passes(order, jobs, console, workers=1, threads=arguments.threads, memory=arguments.max_memory)
    states = do_jobs(jobs, through, console, StageProgress())
    return 0 if possible and not states["failed"] else FAILED
