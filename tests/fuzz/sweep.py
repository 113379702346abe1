"""A campaign of cases with numbers, on the command line: faults are told as they are found, and a
table of outcomes is shown.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

from tests.benchmarks.harness import options

FAULT = "FAULT"
_REPORT = 100  # cases between two reports of progress


class Result(NamedTuple):
    """What came of a case. kind: of the case; why: the reason of a fault or refusal."""

    number: int
    kind: str
    outcome: str
    why: str = ""


def arguments(about: str | None, count: int, **more: Any) -> argparse.Namespace:
    """Read the command line of a campaign: how many cases (`count` unless it is said), of which
    seed, or one of them alone; `numbers` are theirs. more: as `options` takes it.
    """
    alone = {"type": int, "help": "only this case"}
    given = options(about, count=count, seed=0, number=alone, **more)
    given.numbers = range(given.count) if given.number is None else [given.number]
    return given


def report(results: Iterable[Result], given: argparse.Namespace) -> list[int]:
    """Tell of each fault, and show how many cases of each kind had which outcome. Returns the
    numbers of the faults.
    """
    log = partial(print, file=sys.stderr, flush=True)
    counts, faults = Counter[tuple[str, str]](), list[int]()
    for number, kind, outcome, why in results:
        counts[kind, outcome] += 1
        if outcome == FAULT:
            faults.append(number)
            log(f"seed {given.seed} number {number}: {why}")
        if counts.total() % _REPORT == 0:
            log(f"{counts.total()} of {given.count}")
    kinds, outcomes = (sorted(set(names)) for names in zip(*counts, strict=True))
    print(f"{'':12}{'cases':>8}" + "".join(f"{name:>12}" for name in outcomes))
    for kind, summed in [*((kind, [kind]) for kind in kinds), ("all", kinds)]:
        figures = [sum(counts[part, name] for part in summed) for name in outcomes]
        print(f"{kind:12}{sum(figures):8}" + "".join(f"{figure:12}" for figure in figures))
    return faults
