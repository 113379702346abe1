"""Make the networks of `offline/models` from folders of photographs: `python -m tools.training FOLDER... -o DIR`."""

import argparse
import sys
from collections.abc import Callable
from importlib.util import find_spec
from typing import NoReturn

from shared.errors import InputError, PanchromaError
from shared.pattern import CfaPattern
from shared.processors import processors
from shared.tiles import EXPECTED
from tools.batch.console import Console, fault, to_stderr
from tools.batch.jobs import output_folder
from tools.batch.signals import INTERRUPTED, orderly_end

_STEPS, _LEAST = 6000, 20


def main() -> int:
    """Train; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.training", description=__doc__)
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="photographs to learn from, in this folder or below")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="for the networks, and all that is needed to go on")
    parser.add_argument(
        "--pattern", nargs="+", default=["K=4", "K=6", "K=8"], metavar="TILE",
        help=f"a network for each; {EXPECTED} (default: K=4 K=6 K=8)",
    )  # fmt: skip
    parser.add_argument(
        "--start", metavar="TILE", help="begin with the weights of the network for this pattern (default: random ones)"
    )
    parser.add_argument(
        "--steps",
        type=int,
        default=_STEPS,
        metavar="N",
        help=f"of gradient descent; 0 = round the weights of --start again (default: {_STEPS})",
    )
    parser.add_argument("--variants", type=int, default=4, metavar="N", help="examples made of each photograph (default: 4)")
    parser.add_argument("--batch", type=int, default=16, metavar="N", help="pieces of pictures in a step (default: 16)")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default: 0)")
    parser.add_argument("-j", "--jobs", type=int, metavar="N", help="processes and threads (default: one per core)")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the traceback of an error that is a fault of Panchroma")
    arguments = parser.parse_args()
    for name, least in ("steps", 0 if arguments.start else 1), ("variants", 1), ("batch", 1):
        if getattr(arguments, name) < least:
            parser.error(f"--{name} is {getattr(arguments, name)}, expected {least} or more")
    patterns = [_pattern(letters, parser.error) for letters in arguments.pattern]
    start = _pattern(arguments.start, parser.error) if arguments.start else None
    if find_spec("torch") is None:
        parser.error("training needs PyTorch: pip install 'panchroma[training]'")
    from .examples import photographs

    sources = tuple(photographs(arguments.folders))
    if len(sources) < _LEAST:
        parser.error(f"{len(sources)} photographs found; at least {_LEAST} are needed to learn something")
    from .run import Plan, train

    console = Console(verbose=arguments.verbose, options={"verbose": "--verbose", "output": "--output"})
    try:
        with orderly_end():
            output = output_folder(arguments.output)
            for pattern in patterns:
                plan = Plan(
                    sources,
                    pattern,
                    arguments.steps,
                    batch=arguments.batch,
                    variants=arguments.variants,
                    seed=arguments.seed,
                    start=start,
                )
                with console.progress(pattern.name or "/".join(pattern.tile)) as progress:
                    path = train(plan, output, arguments.jobs or processors(), progress, progress.remark)
                console.say(str(path))
    except Exception as error:
        console.error(str(error) if isinstance(error, PanchromaError) else fault(error), cause=error)
        return 1
    except KeyboardInterrupt:
        to_stderr("interrupted: the same command goes on where this one stopped")
        return INTERRUPTED
    return 0


def _pattern(text: str, error: Callable[[str], NoReturn]) -> CfaPattern:
    """The pattern with this text; `error` is called if it is none, or none that a network can be for."""
    try:
        pattern = CfaPattern.of_letters(text)
    except InputError as problem:
        error(f"--{problem}")
    height, width = pattern.block_shape
    if height != width or pattern.channels != "RGB":
        error(f"--pattern: {text} has no square block of red, green and blue")
    return pattern


if __name__ == "__main__":
    sys.exit(main())
