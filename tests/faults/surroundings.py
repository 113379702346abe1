"""Trials of commands in hostile surroundings: planted links, odd names and locales, places that cannot be written, Ctrl-C.

Each returns what it found wrong, a line each.
"""

import os
import random
import signal
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tests.faults.scenario import Scenario
from tests.faults.trials import ENDS, ended, state
from tools.batch.journal import NAME as JOURNAL
from tools.batch.journal import lock_path

_ODD = "é\x1b[31m\n\u202e\udcff<b>"  # in front of a name
_NOWHERE = "/dev/null/nowhere"  # nothing can be written here, not even by root


def planted(scenario: Scenario, folder: Path, kind: str) -> list[str]:
    """Links to an original, or pipes, under the names of files that the command keeps for itself: journal and locks."""
    scenario.lay_out(folder)
    original = folder / next(iter(scenario.inputs))
    for name in (JOURNAL, *(lock_path(Path(output)).name for output in scenario.outputs)):
        path = folder / "out" / name
        match kind:
            case "symbolic link":
                path.symlink_to(original)
            case "hard link":
                path.hardlink_to(original)
            case "pipe":
                os.mkfifo(path)
    found = ended(scenario.start(folder), "", 0, 1)
    (folder / "out" / JOURNAL).unlink(missing_ok=True)
    return found + state(scenario, folder, finished=False)


def odd_names(scenario: Scenario, folder: Path, environment: Mapping[str, str]) -> list[str]:
    """Names with escape sequences, line breaks and bytes that are no text, in a locale."""
    odd = replace(
        scenario,
        arguments=tuple(_ODD + word if word in scenario.inputs else word for word in scenario.arguments),
        inputs={_ODD + name: data for name, data in scenario.inputs.items()},
        outputs={_ODD + name: digest for name, digest in scenario.outputs.items()},
        before={_ODD + name: data for name, data in scenario.before.items()},
    )
    odd.lay_out(folder)
    return ended(odd.start(folder, environment=environment), "", 0) + state(odd, folder, finished=True)


def no_place(scenario: Scenario, folder: Path) -> list[str]:
    """No home, and no folder for caches or temporary files."""
    scenario.lay_out(folder)
    nowhere = dict.fromkeys(("HOME", "TMPDIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), _NOWHERE)
    nowhere["NUMBA_CACHE_LOCATOR_CLASSES"] = "UserProvidedCacheLocator"
    return ended(scenario.start(folder, environment=nowhere), "", 0) + state(scenario, folder, finished=True)


def empty_home(scenario: Scenario, folder: Path) -> list[str]:
    """Nothing is left in the user's home."""
    scenario.lay_out(folder)
    (home := folder / "home").mkdir()
    found = ended(scenario.start(folder, environment={"HOME": str(home), "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": ""}), "", 0)
    return found + [f"{path.relative_to(home)} was left in the home" for path in home.rglob("*")]


def ctrl_c(scenario: Scenario, folder: Path, chance: random.Random, seconds: float) -> list[str]:
    """SIGINT for all processes of the command, as a terminal sends it, while worker processes start too."""
    scenario.lay_out(folder)
    process = scenario.start(folder, extra=("--workers", "4") if scenario.arguments[0] == "render" else (), group=True)
    time.sleep(chance.uniform(0.1, seconds))
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    return ended(process, "", *ENDS[signal.SIGINT]) + state(scenario, folder, finished=False)
