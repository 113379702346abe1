"""A campaign of cases with numbers, on the command line: each is tried, faults are told, and a
table of outcomes is shown.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

_REPORT = 100  # cases between two reports of progress


def options(about: str | None, count: int) -> argparse.ArgumentParser:
    """The options of every campaign: how many cases (`count` unless it is said), of which seed, or
    one of them alone.
    """
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=form)
    parser.add_argument("--count", type=int, default=count, metavar="N", help="cases")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--number", type=int, help="only this case")
    return parser


def numbers(arguments: argparse.Namespace) -> Sequence[int]:
    """The cases that the options ask for."""
    return range(arguments.count) if arguments.number is None else [arguments.number]


def sweep(
    about: str | None,
    attempt: Callable[[int, int], tuple[str, str, str]],
    is_fault: Callable[[str, str], bool],
) -> int:
    """Try the cases that the command line asks for. Returns the exit code: 1 if one is a fault.

    attempt: (seed, number) -> kind of the case, outcome, and what is to be told of it; "" = nothing.
    is_fault: whether it is one, of (kind, outcome).
    """
    arguments, log = options(about, 200).parse_args(), partial(print, file=sys.stderr, flush=True)
    counts: Counter[tuple[str, str]] = Counter()
    for number in numbers(arguments):
        kind, outcome, report = attempt(arguments.seed, number)
        counts[kind, outcome] += 1
        if report:
            log(f"seed {arguments.seed} number {number}: {outcome}: {report}")
        if counts.total() % _REPORT == 0:
            log(f"{counts.total()} of {arguments.count}")
    print(table(counts))
    return int(any(is_fault(*key) for key in counts))


def table(counts: Counter[tuple[str, str]]) -> str:
    """Counts by (kind, outcome) as lines of text, and their sums."""
    kinds, outcomes = (sorted(set(names)) for names in zip(*counts, strict=True))
    rows = [f"{'':12}{'cases':>8}" + "".join(f"{name:>12}" for name in outcomes)]
    for kind, summed in [*((kind, [kind]) for kind in kinds), ("all", kinds)]:
        figures = [sum(counts[part, name] for part in summed) for name in outcomes]
        rows.append(f"{kind:12}{sum(figures):8}" + "".join(f"{figure:12}" for figure in figures))
    return "\n".join(rows)
