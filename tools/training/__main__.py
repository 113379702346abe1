"""Make the networks of `offline/models` from folders of photographs: `python -m
panchroma.tools.training FOLDER... -o DIR`.

An interrupted training goes on where it stopped.
"""

import argparse

from ...shared import CfaPattern, InputError, PanchromaError
from ...shared.processors import processors
from ...shared.tiles import EXPECTED
from ..batch.console import Console
from ..batch.jobs import output_folder
from ..io.versions import install_command

_STEPS, _LEAST = 6000, 20


def training_parser(module: str, description: str, steps: int) -> argparse.ArgumentParser:
    """Parser with the arguments of every training.

    Parameters
    ----------
    module : str
        Of this package, with a dot before its name.
    steps : int
        By default.
    """
    program = f"python -m panchroma.tools.training{module}"
    parser = argparse.ArgumentParser(prog=program, description=description)
    folders = "photographs to learn from, in this folder or below"
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help=folders)
    descent = "of gradient descent (default: %(default)s)"
    parser.add_argument("--steps", type=int, default=steps, help=descent)
    variants = "examples made of each photograph (default: %(default)s)"
    parser.add_argument("--variants", type=int, default=4, help=variants)
    jobs = "processes and threads (default: one per core)"
    parser.add_argument("-j", "--jobs", type=int, default=processors(), help=jobs)
    return parser


def main() -> int:
    """Train; returns the exit code."""
    parser = training_parser("", str(__doc__), _STEPS)
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="for the networks")
    tiles = f"a network for each; {EXPECTED} (default: K=4 K=6 K=8)"
    parser.add_argument("--pattern", nargs="+", default=["K=4", "K=6", "K=8"], help=tiles)
    start = "begin with the weights of the network for this pattern"
    parser.add_argument("--start", help=f"{start}; with --steps 0 only round them again")
    batch = "crops of pictures in a step (default: %(default)s)"
    parser.add_argument("--batch", type=int, default=16, help=batch)
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default: 0)")
    arguments = parser.parse_args()
    if min(arguments.variants, arguments.batch, arguments.steps + bool(arguments.start)) < 1:
        parser.error("--steps, --variants and --batch are 1 or more; --steps 0 needs --start")
    console = Console()
    try:
        patterns = [_pattern(letters) for letters in arguments.pattern]
        begun = _pattern(arguments.start) if arguments.start else None
        from .examples import photographs

        sources = tuple(photographs(arguments.folders))
        if len(sources) < _LEAST:
            raise InputError(f"{len(sources)} photographs found; at least {_LEAST} are needed")
        from .run import Plan, train

        output = output_folder(arguments.output)
        for pattern in patterns:
            steps, batch, variants = arguments.steps, arguments.batch, arguments.variants
            plan = Plan(sources, pattern, steps, batch, variants, seed=arguments.seed, start=begun)
            with console.progress(pattern.name or "/".join(pattern.tile)) as progress:
                path = train(plan, output, arguments.jobs, progress)
            console.say(str(path))
    except PanchromaError as error:
        parser.error(str(error))
    except ModuleNotFoundError as error:
        parser.error(f"training needs the package {error.name}: {install_command('training')}")
    return 0


def _pattern(text: str) -> CfaPattern:
    """Read a pattern. Raises InputError for one that no network can be for."""
    pattern = CfaPattern.of_letters(text)
    height, width = pattern.block_shape
    if height != width or pattern.channels != "RGB":
        raise InputError(f"pattern: {text} has no square block of red, green and blue")
    return pattern


if __name__ == "__main__":
    raise SystemExit(main())
