"""Interrupt the commands that write, take away their disk or permissions, and check what is left.

    python -m tests.faults [--kills 200] [--seed 1] [-j 2]

After each trial every original is compared byte by byte, and every result must be absent, old or new, never incomplete. After each
interruption the command is run again: it must finish, make no complete result twice, and leave no temporary file.
"""

import argparse
import random
import signal
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.faults import surroundings, trials
from tests.faults.scenario import Scenario
from tests.faults.worlds import worlds

Trial = Callable[[Path], list[str]]
_SECONDS = 4.0  # a command takes no longer, even on a busy machine


def planned(scenarios: list[Scenario], kills: int, seed: int) -> list[tuple[str, Trial]]:
    """Every trial, as (name, trial); kills are distributed over the commands in turn."""
    found: list[tuple[str, Trial]] = []

    def add(what: str, trial: Callable[..., list[str]], *given: object) -> None:
        found.append((what, lambda folder: trial(given[0], folder, *given[1:])))

    for what, number, count in (
        ("kill -9", signal.SIGKILL, kills),
        ("SIGINT", signal.SIGINT, -(-kills // 5)),
        ("SIGTERM", signal.SIGTERM, -(-kills // 5)),
    ):
        for index in range(count):
            chance = random.Random(f"{seed} {what} {index}")
            # SIGINT and SIGTERM end capture in order: only kill -9 interrupts it.
            among = scenarios if number == signal.SIGKILL else [each for each in scenarios if each.outputs]
            add(what, trials.interrupted, among[index % len(among)], number, chance, _SECONDS)
    for index in range(-(-kills // 5)):
        chance = random.Random(f"{seed} Ctrl-C {index}")
        among = [each for each in scenarios if each.outputs]
        add("Ctrl-C for all processes", surroundings.ctrl_c, among[index % len(among)], chance, _SECONDS)
    for scenario in [each for each in scenarios if each.outputs]:
        for kind in ("symbolic link", "hard link", "pipe"):
            add("links and pipes in the way", surroundings.planted, scenario, kind)
        add("odd names", surroundings.odd_names, scenario, {})
        add("odd names, no locale", surroundings.odd_names, scenario, {"LC_ALL": "C", "PYTHONUTF8": "0"})
        add("nothing left in the home", surroundings.empty_home, scenario)
        for pages in (1, 5):
            add("disk full", trials.full_disk, scenario, pages)
        add("limit on file size", trials.file_limit, scenario, 2000)
        add("read-only folder", trials.read_only, scenario)
        add("output is an input", trials.own_input, scenario, "symbolic")
        add("output is an input", trials.own_input, scenario, "hard")
        if not scenario.before:
            add("two processes, one folder", trials.two_at_once, scenario)
            add("names that differ in case", trials.case_alone, scenario)
            add("no place for caches", surroundings.no_place, scenario)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200, metavar="N", help="with kill -9; a fifth as many with SIGINT and SIGTERM")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-j", "--jobs", type=int, default=1, metavar="N", help="trials at a time")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        todo = planned(worlds(Path(folder)), arguments.kills, arguments.seed)

    def tried(each: tuple[str, Trial]) -> list[str]:
        with tempfile.TemporaryDirectory(prefix="panchroma-fault-") as folder:
            return each[1](Path(folder) / "world")

    results: dict[str, list[list[str]]] = {}
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for done, ((what, _), found) in enumerate(zip(todo, pool.map(tried, todo), strict=True), 1):
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
