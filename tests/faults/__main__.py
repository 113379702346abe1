"""Interrupt the commands that write, take away their disk or permissions, and check what is left.

    python -m tests.faults [--kills 200] [--seed 1] [-j 2]

After each trial every original is compared byte by byte, and every result must be absent, old or
new, never incomplete. After each interruption the command is run again: it must finish, make no
complete result twice, and leave no temporary file.
"""

import argparse
import random
import signal
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from tests.faults import trials
from tests.faults.scenario import Scenario, worlds

Trial = Callable[[Scenario, Path], list[str]]
ONCE: list[tuple[str, Trial]] = [
    ("two processes, one folder", trials.two_at_once),
    ("no place for caches", trials.no_place),
]
"""Name and trial of what is tried without older results alone."""
TRIALS: list[tuple[str, Trial]] = [
    ("odd names", partial(trials.odd_names, environment={})),
    (
        "odd names, no locale",
        partial(trials.odd_names, environment={"LC_ALL": "C", "PYTHONUTF8": "0"}),
    ),
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
    # SIGINT and SIGTERM end capture in order: only kill -9 interrupts it.
    timed: dict[str, tuple[Callable[..., list[str]], int, list[Scenario]]] = {
        "kill -9": (partial(trials.interrupted, number=signal.SIGKILL), kills, scenarios),
        "SIGINT": (partial(trials.interrupted, number=signal.SIGINT), few, known),
        "SIGTERM": (partial(trials.interrupted, number=signal.SIGTERM), few, known),
        "Ctrl-C for all processes": (trials.ctrl_c, few, known),
        "a worker is killed": (
            trials.killed_worker,
            few,
            [each for each in known if each.name == "render"],
        ),
    }
    found: list[tuple[str, Scenario, Trial]] = [
        (
            what,
            among[index % len(among)],
            partial(trial, chance=random.Random(f"{seed} {what} {index}"), seconds=_SECONDS),
        )
        for what, (trial, count, among) in timed.items()
        for index in range(count)
    ]
    return found + [
        (what, scenario, trial)
        for scenario in known
        for what, trial in (TRIALS if scenario.before else TRIALS + ONCE)
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--kills",
        type=int,
        default=200,
        metavar="N",
        help="with kill -9; a fifth as many with SIGINT and SIGTERM",
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-j", "--jobs", type=int, default=1, metavar="N", help="trials at a time")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        todo = planned(worlds(Path(folder)), arguments.kills, arguments.seed)

    def tried(each: tuple[str, Scenario, Trial]) -> list[str]:
        _, scenario, trial = each
        with tempfile.TemporaryDirectory(prefix="panchroma-fault-") as folder:
            return trial(scenario, Path(folder) / "world")

    results: dict[str, list[list[str]]] = {}
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for done, ((what, *_), found) in enumerate(
            zip(todo, pool.map(tried, todo), strict=True), 1
        ):
            results.setdefault(what, []).append(found)
            if done % 20 == 0:
                print(f"{done} of {len(todo)} trials", file=sys.stderr, flush=True)
            for fault in found:
                print(f"{what}: {fault}", file=sys.stderr, flush=True)
    print(f"{'':28}{'trials':>8}{'faults':>8}")
    for what, outcomes in results.items():
        print(f"{what:28}{len(outcomes):8}{sum(map(bool, outcomes)):8}")
    return int(any(map(any, results.values())))


if __name__ == "__main__":
    sys.exit(main())
