"""Make the networks of `offline/models` from folders of photographs: `python -m tools.training FOLDER... -o DIR`."""

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

from shared.errors import PanchromaError
from shared.processors import processors
from tools.host.console import Console, to_stderr
from tools.host.jobs import output_folder
from tools.host.signals import INTERRUPTED, orderly_end

_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".npy", ".dng"}
_STEPS, _LEAST = 6000, 20


def main() -> int:
    """Train; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.training", description=__doc__)
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="photographs to learn from, in this folder or below")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="for the networks, and all that is needed to go on")
    parser.add_argument("--period", type=int, nargs="+", default=[4, 6, 8], metavar="K", help="periods of the pattern, even")
    parser.add_argument("--steps", type=int, default=_STEPS, metavar="N", help=f"of gradient descent (default: {_STEPS})")
    parser.add_argument("--variants", type=int, default=4, metavar="N", help="examples made of each photograph (default: 4)")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default: 0)")
    parser.add_argument("-j", "--jobs", type=int, metavar="N", help="processes and threads (default: one per core)")
    arguments = parser.parse_args()
    for name in ("steps", "variants"):
        if getattr(arguments, name) < 1:
            parser.error(f"--{name} is {getattr(arguments, name)}, expected 1 or more")
    if any(period < 4 or period % 2 for period in arguments.period):
        parser.error("--period: even numbers from 4 on are possible")
    if find_spec("torch") is None:
        parser.error("training needs PyTorch: pip install 'panchroma[training]'")
    sources = tuple(
        str(path)
        for folder in arguments.folders
        for path in sorted(Path(folder).rglob("*"))
        if path.suffix.lower() in _SUFFIXES and path.is_file()
    )
    if len(sources) < _LEAST:
        parser.error(f"{len(sources)} photographs found; at least {_LEAST} are needed to learn something")
    from .run import Plan, train

    console = Console()
    try:
        with orderly_end():
            output = output_folder(arguments.output)
            for period in arguments.period:
                plan = Plan(sources, period, arguments.steps, variants=arguments.variants, seed=arguments.seed)
                with console.progress(f"K = {period}") as progress:
                    path = train(plan, output, arguments.jobs or processors(), progress, progress.remark)
                console.say(str(path))
    except PanchromaError as error:
        console.error(str(error))
        return 1
    except KeyboardInterrupt:
        to_stderr("interrupted: the same command goes on where this one stopped")
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    sys.exit(main())
