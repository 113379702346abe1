"""Interrupt the commands that write, take away their disk or permissions, and check what is left.

    python -m tests.faults [--kills 200] [--seed 1] [-j 2]

After each trial every original is compared byte by byte, and every result must be absent, old or
new, never incomplete. After each interruption the command is run again: it must finish, make no
complete result twice, and leave no temporary file.
"""

import random
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from tests.benchmarks.harness import options
from tests.faults import trials
from tests.faults.scenario import Scenario, worlds

Trial = Callable[[Scenario, Path], list[str]]
ONCE: list[tuple[str, Trial]] = [
    ("two processes, one folder", trials.two_at_once),
    ("no place for caches", trials.no_place),
]
"""Name and trial of what is tried without older results alone."""
TRIALS: list[tuple[str, Trial]] = [
    ("odd names", trials.odd_names),
    ("odd names, no locale", partial(trials.odd_names, LC_ALL="C", PYTHONUTF8="0")),
    ("nothing left in the home", trials.empty_home),
    *(("disk full", partial(trials.full_disk, pages=pages)) for pages in (1, 5)),
    ("limit on file size", partial(trials.file_limit, size=2000)),
    ("read-only folder", trials.read_only),
]
"""Of all other trials."""
_SECONDS = 4.0  # a command takes no longer, even on a busy machine


def planned(scenarios: list[Scenario], kills: int, seed: int) -> list[tuple[str, Scenario, Trial]]:
    """Every trial, with its name and scenario; kills are distributed over the commands in turn."""
    known, few = [each for each in scenarios if each.outputs], -(-kills // 5)
    renders = [each for each in known if each.name == "render"]
    # SIGINT and SIGTERM end capture in order: only kill -9 interrupts it.
    timed: tuple[tuple[str, Callable[..., list[str]], int, list[Scenario]], ...] = (
        ("kill -9", partial(trials.interrupted, number=signal.SIGKILL), kills, scenarios),
        ("SIGINT", partial(trials.interrupted, number=signal.SIGINT), few, known),
        ("SIGTERM", partial(trials.interrupted, number=signal.SIGTERM), few, known),
        ("Ctrl-C for all processes", trials.ctrl_c, few, known),
        ("a worker is killed", trials.killed_worker, few, renders),
    )
    found: list[tuple[str, Scenario, Trial]] = []
    for what, trial, count, among in timed:
        for index in range(count):
            chance = random.Random(f"{seed} {what} {index}")
            tried = partial(trial, chance=chance, seconds=_SECONDS)
            found.append((what, among[index % len(among)], tried))
    for scenario in known:
        trials_of = TRIALS if scenario.before else TRIALS + ONCE
        found += [(what, scenario, trial) for what, trial in trials_of]
    return found


def main() -> int:
    arguments = options(__doc__, kills=200, seed=1, jobs=1)
    with tempfile.TemporaryDirectory() as folder:
        todo = planned(worlds(Path(folder)), arguments.kills, arguments.seed)

    def tried(each: tuple[str, Scenario, Trial]) -> list[str]:
        what, scenario, trial = each
        with tempfile.TemporaryDirectory(prefix="panchroma-fault-") as folder:
            found = trial(scenario, Path(folder) / "world")
        for fault in found:
            print(f"{what}: {fault}", file=sys.stderr, flush=True)
        return found

    with ThreadPoolExecutor(arguments.jobs) as pool:
        results = list(pool.map(tried, todo))
    faults = Counter(what for (what, *_), found in zip(todo, results, strict=True) if found)
    print(f"{'':28}{'trials':>8}{'faults':>8}")
    for what, count in Counter(what for what, *_ in todo).items():
        print(f"{what:28}{count:8}{faults[what]:8}")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
