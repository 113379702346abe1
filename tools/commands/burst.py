"""Merge a series of one scene, hand-held or from a sensor that moves by known steps, into one
picture.

The frames are those of one `capture --burst` or `simulate --burst`, in a folder, or any shots of
one camera that are named. The first of those that are as sharp as any is the reference, whose view
and capture data the picture has. Frames are aligned, and merged where they agree with the
reference; what has moved is the reference's alone. A frame that does not fit, or is a copy of
another one, is left out, and named. The picture is called STEM.EXT for frames STEM-1.dng,
STEM-2.dng ..., otherwise as the first file.
"""

import argparse

from ...shared import read_dng
from ..batch.burst_files import BurstOrder, checked_reference, pictures, series, series_stem
from ..batch.console import Console
from ..batch.folders import DNGS, search
from ..batch.jobs import FAILED, Job
from ..batch.run import render_all
from .options import add, add_pictures, numbers, order_fields

USAGE = "SHOT ... -o DIR"
EXAMPLE = "panchroma burst shots/20261127T101500.000Z-000001-*.dng -o pictures"


def _shifts(text: str) -> tuple[tuple[float, ...], ...]:
    return tuple(map(numbers(2, "2,-0.5"), text.split()))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma burst`."""
    shots = "the DNGs of one series, or a folder with them in it or below"
    parser.add_argument("shots", metavar="SHOT", nargs="+", help=shots)
    add(parser, "output", help="folder for STEM.EXT, created if missing")
    reference = "the frame that the picture shows (default: the first of the sharpest)"
    parser.add_argument("--reference", metavar="SHOT", help=reference)
    place = "where the sensor was at each shot, in its pixels, columns to the right and rows down"
    each = "X,Y for each shot, with blanks between them"
    first = "nothing is aligned then, and the reference is the first shot by default"
    shifts = f"pixel shift: {place}: {each}; {first}"
    parser.add_argument("--shifts", metavar='"X,Y X,Y ..."', type=_shifts, default=(), help=shifts)
    add_pictures(parser, "best", "unlearned")
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Make the picture; returns the exit code."""
    fields = order_fields(arguments)
    files = search(arguments.shots, DNGS, output=fields["folder"], set_aside=pictures)
    if files.report(console):
        return FAILED
    names = series(files.sources)
    if len(names) == 1:
        read_dng(names[0])  # says what is wrong with it
    reference = checked_reference(names, arguments.reference, arguments.shifts)
    order = BurstOrder(reference=reference, shifts=arguments.shifts, **fields)
    output = order.folder / f"{series_stem(names)}{order.kind.suffix}"
    from_folder = all(source.from_folder for source in files.sources)
    job = Job(names[0], (output,), from_folder, tuple(names))
    return render_all(order, [job], console, jobs=1, memory=arguments.max_memory)
