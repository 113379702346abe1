"""How fast is it, here? Time the renderer and its stages, the preview, the files, and rivals on a Bayer mosaic of the same size.

Speeds are for arrays in memory, and from a DNG to a 16-bit TIFF on the disk without the start of the program. Everything runs once
per round, after a warm-up round that does not count; a ratio is the median of the rounds' ratios. With several sizes: measure how
time and memory grow, from a DNG to a TIFF, each size in a process of its own.
"""

import argparse
import os

from tools.host.console import Console
from tools.host.options import check_at_least_one
from tools.host.processors import THREAD_VARIABLES

_MEGAPIXELS, _ROUNDS, _FRAMES = 3.2, 9, 100
_PREVIEW_MEGAPIXELS = 12.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma bench`."""
    parser.add_argument(
        "--megapixels",
        nargs="+",
        type=float,
        default=[_MEGAPIXELS],
        metavar="N",
        help="size of the frame; several: measure how time and memory grow",
    )
    parser.add_argument("--rounds", type=int, default=_ROUNDS, metavar="N", help="rounds; each measures everything once")
    parser.add_argument(
        "--frames", type=int, default=_FRAMES, metavar="N", help=f"number of previews of {_PREVIEW_MEGAPIXELS:g} MP"
    )
    parser.add_argument("-j", "--threads", type=int, metavar="N", help="threads, for rivals too (default, maximum: one per core)")
    parser.add_argument("--json", action="store_true", help="print one JSON object with every figure to stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Measure and print; returns the exit code."""
    check_at_least_one(arguments, "rounds", "frames")
    from offline import threads

    used = threads()
    # For the rivals, which are loaded later. Numba is loaded already and takes no other number.
    os.environ.update({name: str(used) for name in THREAD_VARIABLES if not name.startswith("NUMBA")})

    from tools.evaluation.speed.environment import environment
    from tools.evaluation.speed.material import Material, frame_shape
    from tools.evaluation.speed.measure import measure_growth, measure_previews, measure_speeds
    from tools.evaluation.speed.tables import environment_lines

    sizes = [Material(frame_shape(megapixels)) for megapixels in arguments.megapixels]
    facts = environment(used)
    console.say(*environment_lines(facts))
    if len(sizes) > 1:
        found = measure_growth(sizes, used, console)
    else:
        small = Material(frame_shape(min(_PREVIEW_MEGAPIXELS, 4 * arguments.megapixels[0])))
        found = measure_speeds(sizes[0], arguments.rounds, used, console)
        found |= measure_previews(small, arguments.frames, used, console)
    console.record(environment=facts, **found)
    return 0
