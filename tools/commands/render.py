"""Render shots at full quality: one, or all that are in folders, by as many processes as the machine bears.

With --bits 32 --space camera the result is float32 in scene units, unclipped: it can be subtracted from a truth of `simulate`.
Everything else is for looking at: white-balanced, with an ICC profile and the capture data. DIR/.panchroma-journal.jsonl notes what
was made of what: with --resume a run that was cut off goes on, and a folder that has changed is brought up to date.
"""

import argparse
import secrets
from collections.abc import Sequence

from shared import read_camera
from shared.errors import InputError, PanchromaError
from shared.writing import sweep
from tools.host.console import Console
from tools.host.jobs import FAILED, add_limit, fail, identity, output_folder, refuse_existing, refuse_loss
from tools.host.memory import allowed_memory
from tools.pictures.writer import POSSIBLE, PictureKind, check_gain
from tools.rendering.defect_list import read_defects
from tools.rendering.order import Order
from tools.rendering.run import Hands, passes, render_shots
from tools.rendering.shots import Shard, Shot, expand

_PRESETS = ("best", "paper")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma render`."""
    parser.add_argument("shots", nargs="+", metavar="SHOT", help="a DNG of Panchroma, or a folder with any below it")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="existing folder for STEM.EXT; subfolders as they are")
    parser.add_argument("-f", "--format", choices=tuple(POSSIBLE), default="tif", help="dng: linear, for a raw developer to finish")
    parser.add_argument("--bits", type=int, choices=(8, 16, 32), help="per sample (default: the format's)")
    spaces = tuple(dict.fromkeys(space for possible in POSSIBLE.values() for space in possible))
    parser.add_argument("--space", choices=spaces, help="colours (default: the format's; camera: scene units as measured)")
    parser.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="gain of a display picture")
    parser.add_argument("--camera", metavar="FILE", help="camera.json to use instead of the calibration in the shots")
    parser.add_argument("--defects", metavar="FILE", help="more defective pixels: lines of row, column (from 0), or JSON")
    parser.add_argument("--preset", choices=_PRESETS, default=_PRESETS[0], help="paper: the published method, literally")
    add_limit(parser)
    run_ = parser.add_argument_group("the run")
    run_.add_argument("--resume", action="store_true", help="keep results that are current, make anew those of ours that are not")
    run_.add_argument("--overwrite", action="store_true", help="replace results that exist, whosever they are")
    run_.add_argument("--shard", metavar="I/N", help="only part I of N, 1 to N: for job arrays")
    run_.add_argument(
        "--workers", type=int, metavar="N", help="processes (default: of many shots as many as cores and memory bear)"
    )
    run_.add_argument("-j", "--jobs", dest="threads", type=int, metavar="N", help="threads of each (default: all cores are used)")
    run_.add_argument("--max-memory", metavar="SIZE", help="of all processes, for example 4G (default: most of what is free)")
    run_.add_argument("--scheduler", metavar="ADDRESS", help="render on the workers of this dask scheduler, tcp://HOST:PORT")
    run_.add_argument("--scheduler-file", metavar="FILE", help="the same, of the scheduler that wrote this file")
    run_.add_argument("--dry-run", action="store_true", help="only say what would be done")
    run_.add_argument("--json", action="store_true", help="one object per shot on stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    order = _order(arguments)
    allowed_memory(arguments.max_memory)
    if arguments.workers is not None and arguments.workers < 1:
        raise InputError(f"--workers is {arguments.workers}, expected 1 or more")
    if arguments.workers is not None and (arguments.scheduler or arguments.scheduler_file):
        raise InputError("--workers goes without a scheduler, which has workers of its own")
    if arguments.scheduler and arguments.scheduler_file:
        raise InputError("--scheduler or --scheduler-file: one of them")
    shard = Shard.parse(arguments.shard) if arguments.shard else Shard(1, 1)
    found, failures = expand(arguments.shots, order.folder, order.kind.suffix)
    for source, what in failures:
        fail(source, (), what, console)
    shots, all_possible = _possible(found, shard, order, console)
    for below in {shot.output.parent for shot in shots} - {order.folder}:
        sweep(below)
    if (arguments.scheduler or arguments.scheduler_file) and not arguments.dry_run:
        from tools.host.cluster import connected
        from tools.rendering import remote

        with connected(arguments.scheduler, arguments.scheduler_file) as client:
            through = remote.passes(order, client, arguments.threads, arguments.max_memory, console.note)
            all_made = render_shots(shots, through, console)
    else:
        hands = Hands.of(order, shots, 1 if arguments.dry_run else arguments.workers, arguments.threads, arguments.max_memory)
        all_made = render_shots(shots, passes(order, hands, console, len(shots)), console)
    return 0 if all_made and all_possible and not failures else FAILED


def _order(arguments: argparse.Namespace) -> Order:
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space)
    check_gain(kind, arguments.exposure)
    if arguments.defects and arguments.preset == "paper":
        raise InputError("--defects needs --preset best: the published method takes every sample for good")
    return Order(
        folder=output_folder(arguments.output),
        kind=kind,
        preset=arguments.preset,
        exposure=arguments.exposure,
        camera=read_camera(arguments.camera) if arguments.camera else None,
        defects=read_defects(arguments.defects) if arguments.defects else (),
        max_pixels=arguments.max_pixels,
        run=secrets.token_hex(8),
        resume=arguments.resume,
        overwrite=arguments.overwrite,
        dry_run=arguments.dry_run,
    )


def _possible(found: Sequence[Shot], shard: Shard, order: Order, console: Console) -> tuple[list[Shot], bool]:
    """The shots of the shard whose pictures lose nothing and stand in nobody's way; a line for each other; whether there is none.

    Of two shots that want one name the first gets it, whichever shards they are in.
    """
    inputs = {identity(shot.source) for shot in found} - {None}
    planned: dict[str, str] = {}
    possible, all_well = [], True
    for shot in found:
        try:
            refuse_loss(shot.source, (shot.output,), inputs, planned)
            if not shard.has(order.name(shot.output)):
                continue
            if not (order.overwrite or order.resume):
                refuse_existing((shot.output,))
        except PanchromaError as error:
            all_well = False
            fail(shot.source, (shot.output,), str(error), console)
        else:
            possible.append(shot)
    return possible, all_well
