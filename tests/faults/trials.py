"""Trials of commands: killed, stopped, on a full disk, two at once, with odd names. Each returns
what is wrong, a line each.
"""

import os
import random
import re
import resource
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from panchroma.shared.dng import verify_dng
from panchroma.shared.errors import PanchromaError
from tests.faults.scenario import Process, Scenario

# How a command may end after a signal. A negative number: the signal came before Python took it
# over, or after it let go of it.
ENDS = {signal.SIGKILL: (-9, 0), signal.SIGINT: (130, 0, -2), signal.SIGTERM: (143, 0, -15)}
PATIENCE = 1800.0  # seconds: without a place for kernels every process compiles them all
_CONTROLS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
_STEPS = 60  # operations on files of the longest command; a point beyond the last kills nothing
_ODD = "é\x1b[31m\n\u202e\udcff<b>"  # in front of a name
_NOWHERE = "/dev/null/nowhere"  # nothing can be written here, not even by root


def interrupted(
    scenario: Scenario, folder: Path, number: int, chance: random.Random, seconds: float
) -> list[str]:
    """Send the signal `number` at a random operation on files or, as often, after up to `seconds`;
    then run again to the end.
    """
    scenario.lay_out(folder)
    point = chance.randint(1, _STEPS) if chance.random() < 0.5 else 0
    process = scenario.start(folder, point, number)
    if not point:
        time.sleep(chance.uniform(0.1, seconds))
        process.send_signal(number)
    found = ended(process, "", *ENDS[signal.Signals(number)]) + state(
        scenario, folder, finished=False
    )
    if number != signal.SIGKILL and any((folder / "out").glob(".*.part")):
        found.append("left a temporary file")
    if not found:
        found += _again(scenario, folder)
    return found


def _again(scenario: Scenario, folder: Path) -> list[str]:
    """Run the command again: it must make what is missing, and nothing twice.

    It refuses a scene of whose two results one exists, since that may have been made with other
    settings; --overwrite makes both.
    """
    whole = {
        path.name: path.stat().st_ino
        for path in (folder / "out").iterdir()
        if not path.name.startswith(".")
    }
    scenario.start(folder).communicate(timeout=PATIENCE)
    found = []
    if "--overwrite" not in scenario.arguments:
        now = {path.name: path.stat().st_ino for path in (folder / "out").iterdir()}
        found = [
            f"{name} was made again" for name, inode in whole.items() if now.get(name) != inode
        ]
        there, wanted = (
            Counter(name.partition(".")[0] for name in some) for some in (whole, scenario.outputs)
        )
        if any(there[stem] < wanted[stem] for stem in there):
            scenario.start(folder, extra=("--overwrite",)).communicate(timeout=PATIENCE)
    return found + state(scenario, folder, finished=True)


def state(scenario: Scenario, folder: Path, *, finished: bool) -> list[str]:
    """What is wrong in the folder. finished: every result must be there, and nothing else."""
    if scenario.outputs:
        return scenario.faults(folder, finished=finished)
    found = []
    for path in (folder / "out").iterdir():
        if path.name.endswith(".panchroma.part") and not finished:
            continue
        try:
            verify_dng(path)
        except PanchromaError as error:
            found.append(str(error))
    return found


@contextmanager
def small_disk(folder: Path, size: int) -> Iterator[bool]:
    """Mount a file system of `size` bytes at `folder`/out. Yields whether that worked: only root
    may mount.
    """
    out = folder / "out"
    out.mkdir(parents=True, exist_ok=True)
    line = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(out)]
    mounted = (
        os.geteuid() == 0 and subprocess.run(line, capture_output=True, check=False).returncode == 0
    )
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(out)], check=True)


def ended(process: Process, words: str, *codes: int) -> list[str]:
    """Wait for the process, which must say `words`, leave with one of `codes`, and show no fault,
    and nothing a terminal obeys.
    """
    shown, said = (
        stream.decode(errors="surrogateescape") for stream in process.communicate(timeout=PATIENCE)
    )
    wrong = {
        f"left with {process.returncode} instead of {codes}, {words!r} expected": process.returncode
        not in codes
        or words not in said,
        "a traceback or a fault": "Traceback" in said or "a fault of Panchroma" in said,
        "control characters": _CONTROLS.search(shown + said) is not None,
    }
    return [f"{what}: {shown[-300:]!r} {said[-300:]!r}" for what, is_so in wrong.items() if is_so]


def _refused(scenario: Scenario, folder: Path, process: Process, words: str) -> list[str]:
    found = ended(process, words, 1, 2) + state(scenario, folder, finished=False)
    return found + ["left a temporary file"] * any((folder / "out").glob(".*.part"))


def killed_worker(
    scenario: Scenario, folder: Path, chance: random.Random, seconds: float
) -> list[str]:
    """One of two processes is killed, as for want of memory; then the rest is made."""
    scenario.lay_out(folder)
    process = scenario.start(folder, extra=("--jobs", "2"))
    time.sleep(chance.uniform(0.1, seconds))
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    workers = [
        int(each) for each in (children.read_text().split() if process.poll() is None else ())
        if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()
    ]  # fmt: skip
    for worker in workers[:1]:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    _, said = process.communicate(timeout=PATIENCE)
    failed = said.decode().count("its process was killed")
    made = sum((folder / "out" / name).exists() for name in scenario.outputs)
    found = state(scenario, folder, finished=False)
    if process.returncode not in (0, 1, 2) or "Traceback" in said.decode():
        found.append(f"left with {process.returncode}: {said[-300:]!r}")
    if process.returncode == 1 and (failed != 1 or made != len(scenario.outputs) - 1):
        found.append(f"{failed} lost, {made} made: {said[-300:]!r}")
    return found or _again(scenario, folder)


def full_disk(scenario: Scenario, folder: Path, pages: int) -> list[str]:
    """A disk with room for `pages` pages of memory beside the older results."""
    with small_disk(folder, (pages + len(scenario.before)) * resource.getpagesize()) as mounted:
        if not mounted:
            return []
        scenario.lay_out(folder)
        return _refused(scenario, folder, scenario.start(folder), "the disk is full")


def file_limit(scenario: Scenario, folder: Path, size: int) -> list[str]:
    """A limit of `size` bytes on every file (ulimit -f)."""
    scenario.lay_out(folder)
    return _refused(
        scenario,
        folder,
        scenario.start(folder, limit=size),
        "is larger than the file system or a limit",
    )


def read_only(scenario: Scenario, folder: Path) -> list[str]:
    """An output folder that cannot be written to."""
    out = folder / "out"
    if os.geteuid():
        scenario.lay_out(folder)
        out.chmod(0o500)
        try:
            return _refused(scenario, folder, scenario.start(folder), "no permission")
        finally:
            out.chmod(0o700)
    with small_disk(folder, 1 << 20) as mounted:
        if not mounted:
            return []
        scenario.lay_out(folder)
        subprocess.run(["mount", "-o", "remount,ro", str(out)], check=True)
        return _refused(scenario, folder, scenario.start(folder), "no permission")


def two_at_once(scenario: Scenario, folder: Path) -> list[str]:
    """Two processes that make the same results in one folder: each result must be there,
    complete.
    """
    scenario.lay_out(folder)
    both = [scenario.start(folder), scenario.start(folder)]
    for process in both:
        process.communicate(timeout=PATIENCE)
    found = state(scenario, folder, finished=True)
    return found + [
        f"left with {process.returncode}" for process in both if process.returncode not in (0, 1)
    ]


def odd_names(scenario: Scenario, folder: Path, environment: Mapping[str, str]) -> list[str]:
    """Names with escape sequences, line breaks and bytes that are no text, in a locale."""
    odd = replace(
        scenario,
        arguments=tuple(
            _ODD + word if word in scenario.inputs else word for word in scenario.arguments
        ),
        inputs={_ODD + name: data for name, data in scenario.inputs.items()},
        outputs={_ODD + name: digest for name, digest in scenario.outputs.items()},
        before={_ODD + name: data for name, data in scenario.before.items()},
    )
    odd.lay_out(folder)
    return ended(odd.start(folder, environment=environment), "", 0) + state(
        odd, folder, finished=True
    )


def no_place(scenario: Scenario, folder: Path) -> list[str]:
    """No home, and no folder for caches or temporary files."""
    scenario.lay_out(folder)
    nowhere = dict.fromkeys(
        ("HOME", "TMPDIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), _NOWHERE
    )
    nowhere["NUMBA_CACHE_LOCATOR_CLASSES"] = "UserProvidedCacheLocator"
    return ended(scenario.start(folder, environment=nowhere), "", 0) + state(
        scenario, folder, finished=True
    )


def empty_home(scenario: Scenario, folder: Path) -> list[str]:
    """Nothing is left in the user's home."""
    scenario.lay_out(folder)
    (home := folder / "home").mkdir()
    found = ended(
        scenario.start(
            folder, environment={"HOME": str(home), "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": ""}
        ),
        "",
        0,
    )
    return found + [f"{path.relative_to(home)} was left in the home" for path in home.rglob("*")]


def ctrl_c(scenario: Scenario, folder: Path, chance: random.Random, seconds: float) -> list[str]:
    """SIGINT for all processes of the command, as a terminal sends it, while worker processes start
    too.
    """
    scenario.lay_out(folder)
    process = scenario.start(
        folder, extra=("--jobs", "4") if scenario.arguments[0] == "render" else (), group=True
    )
    time.sleep(chance.uniform(0.1, seconds))
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    return ended(process, "", *ENDS[signal.SIGINT]) + state(scenario, folder, finished=False)
