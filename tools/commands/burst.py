"""Merge a series of one scene, hand-held or from a sensor that moves by known steps, into one picture.

The frames are those of one `capture --burst` or `simulate --burst`, in a folder, or any shots of one camera that are named. The
first of those that are as sharp as any is the reference, whose view and capture data the picture has. Frames are aligned, and
merged where they agree with the reference; what has moved is the reference's alone. A frame that does not fit, or is a copy of
another one, is left out, and named. The picture is called STEM.EXT for frames STEM-1.dng, STEM-2.dng ..., otherwise as the first
file.
"""

import argparse
import math

from shared import read_dng
from shared.errors import InputError
from tools.host import options
from tools.host.console import Console
from tools.host.folders import DNGS, search
from tools.host.jobs import FAILED, identity
from tools.host.memory import allowed_memory, reuse_memory
from tools.rendering.burst import BurstOrder, Shift
from tools.rendering.options import add_picture, add_run, order_fields
from tools.rendering.run import Resources, passes, possible_shots, render_shots
from tools.rendering.series import series, series_stem
from tools.rendering.shots import Shard, Shot

_MOST = 1000.0  # pixels that a sensor moves


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma burst`."""
    parser.add_argument("shots", nargs="+", metavar="SHOT", help="the DNGs of one series, or a folder with them in it or below")
    options.add_output_folder(parser, "STEM.EXT")
    parser.add_argument("--reference", metavar="SHOT", help="the frame that the picture shows (default: the first of the sharpest)")
    parser.add_argument(
        "--shifts",
        type=_parsed_shift,
        nargs="+",
        default=[],
        metavar="X,Y",
        help="pixel shift: where the sensor was at each shot, in its pixels, columns to the right and rows down; nothing is "
        "aligned then, and the reference is the first shot by default",
    )
    parser.add_argument(
        "--report", action="store_true", help="also write STEM.html: frames, motion, and the picture beside one shot's"
    )
    add_picture(parser)
    run_ = parser.add_argument_group("the run")
    add_run(run_)
    run_.add_argument("-j", "--jobs", dest="threads", type=int, metavar="N", help="threads (default: use all cores)")
    options.add_max_memory(run_)
    options.add_json(run_, "picture")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Make the picture; returns the exit code."""
    reuse_memory()
    allowed_memory(arguments.max_memory)
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
    order = BurstOrder(preset="best", reference=reference, shifts=shifts, **fields)
    stem = series_stem(names)
    page = folder / f"{stem}.html" if arguments.report else None
    shot = Shot(names[0], folder / f"{stem}{suffix}", all(each.found for each in found.sources), tuple(names), page)
    shots, possible = possible_shots([shot], Shard(1, 1), order, console)
    resources = Resources.of(order, shots, 1, arguments.threads, arguments.max_memory)
    made = render_shots(shots, passes(order, resources, console, 1), console)
    return 0 if made and possible else FAILED


def _parsed_shift(text: str) -> Shift:
    """(right, down) of a text such as "2,-0.5". Raises InputError."""
    try:
        right, down = (float(word) for word in text.split(","))
    except ValueError:
        right = down = math.nan
    if not (abs(right) <= _MOST and abs(down) <= _MOST):
        raise InputError(f"--shifts has {text!r}, expected pixels to the right and down such as 2,0, {_MOST:g} at most")
    return right, down
