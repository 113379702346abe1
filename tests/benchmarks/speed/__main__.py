"""How fast is it, here? Time the renderer and its stages, the preview, the files, and rivals on a Bayer mosaic of the same size.

    python -m tests.benchmarks.speed [--megapixels N ...] [--rounds 9] [--frames 100] [-j THREADS] [--json]

Speeds are for arrays in memory, and from a DNG to a 16-bit TIFF on the disk without the start of the program. Everything runs once
per round, after a warm-up round that does not count; a ratio is the median of the rounds' ratios. With several sizes: measure how
time and memory grow, from a DNG to a TIFF, each size in a process of its own.
"""

import argparse
import os

from offline import threads, use_threads
from tests.benchmarks.speed.environment import environment
from tests.benchmarks.speed.material import Material, frame_shape
from tests.benchmarks.speed.measure import measure_growth, measure_previews, measure_speeds
from tests.benchmarks.speed.tables import environment_lines
from tools.host.console import Console
from tools.host.processors import THREAD_VARIABLES

_MEGAPIXELS, _PREVIEW_MEGAPIXELS = 3.2, 12.0


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megapixels", nargs="+", type=float, default=[_MEGAPIXELS], metavar="N")
    parser.add_argument("--rounds", type=int, default=9, metavar="N")
    parser.add_argument("--frames", type=int, default=100, metavar="N", help=f"previews of {_PREVIEW_MEGAPIXELS:g} MP")
    parser.add_argument("-j", "--threads", type=int, default=threads(), metavar="N", help="for rivals too")
    parser.add_argument("--json", action="store_true", help="print one JSON object with every figure to stdout")
    arguments = parser.parse_args()
    console, used = Console(json=arguments.json), arguments.threads
    use_threads(used)
    # For the rivals, which are loaded later. Numba is loaded already and takes no other number.
    os.environ.update({name: str(used) for name in THREAD_VARIABLES if not name.startswith("NUMBA")})
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


if __name__ == "__main__":
    main()
