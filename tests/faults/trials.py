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
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tests.faults.scenario import Process, Scenario

# How a command may end after a signal. A negative number: the signal came before Python took it
# over, or after it let go of it.
ENDS = {signal.SIGKILL: (-9, 0), signal.SIGINT: (130, 0, -2), signal.SIGTERM: (143, 0, -15)}
PATIENCE = 1800.0  # seconds: without a place for kernels every process compiles them all
_CONTROLS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
_STEPS = 60  # operations on files of the longest command; a point beyond the last kills nothing
_ODD = "é\x1b[31m\n\u202e\udcff<b>"  # in front of a name
_NOWHERE = "/dev/null/nowhere"  # nothing can be written here, not even by root
# Counts the program's operations on files of the output folder, and kills it before the N-th:
# wherever a file may be incomplete.
_KILLED = """
import os, sys
count = 0
def step(*_):
    global count
    count += 1
    if count == int(os.environ["FAULT_POINT"]):
        os.kill(os.getpid(), int(os.environ["FAULT_SIGNAL"]))
def heard(event, arguments):
    operations = "open", "os.link", "os.rename", "os.remove", "os.symlink"
    if event in operations and any(str(part).startswith("out/") for part in arguments):
        step()
fsync = os.fsync
def synced(descriptor):
    step()
    fsync(descriptor)
    step()
os.fsync = synced
sys.addaudithook(heard)
"""


def interrupted(
    scenario: Scenario, folder: Path, number: int, chance: random.Random, seconds: float
) -> list[str]:
    """Send the signal `number` at a random operation on files or, as often, after up to `seconds`;
    then run again to the end.
    """
    scenario.lay_out(folder)
    point = chance.randint(1, _STEPS) if chance.random() < 0.5 else 0
    if point:
        when = {"FAULT_POINT": str(point), "FAULT_SIGNAL": str(int(number))}
        process = scenario.start(folder, script=_KILLED, **when)
    else:
        process = scenario.start(folder)
        time.sleep(chance.uniform(0.1, seconds))
        process.send_signal(number)
    faults = ended(process, "", *ENDS[signal.Signals(number)])
    faults += scenario.faults(folder, finished=False)
    if number != signal.SIGKILL:
        faults += _temporary(folder)
    return faults or _again(scenario, folder)


def _temporary(folder: Path) -> list[str]:
    return ["left a temporary file"] * any((folder / "out").glob(".*.part"))


def _again(scenario: Scenario, folder: Path) -> list[str]:
    """Run the command again: it must make what is missing, and nothing twice.

    It refuses a scene of whose two results one exists, since that may have been made with other
    settings; --overwrite makes both.
    """

    def inodes() -> dict[str, int]:
        paths = (folder / "out").iterdir()
        return {path.name: path.stat().st_ino for path in paths if path.name[0] != "."}

    def stems(names: Iterable[str]) -> Counter[str]:
        return Counter(name.partition(".")[0] for name in names)

    before, faults = inodes(), []
    scenario.start(folder).communicate(timeout=PATIENCE)
    if "--overwrite" not in scenario.arguments:
        now, expected = inodes(), stems(scenario.outputs)
        faults = [f"{name} was made again" for name in before if now.get(name) != before[name]]
        if any(count < expected[stem] for stem, count in stems(before).items()):
            scenario.start(folder, "--overwrite").communicate(timeout=PATIENCE)
    return faults + scenario.faults(folder, finished=True)


@contextmanager
def small_disk(folder: Path, size: int) -> Iterator[bool]:
    """Mount a file system of `size` bytes at `folder`/out. Yields whether that worked: only root
    may mount.
    """
    out = folder / "out"
    out.mkdir(parents=True, exist_ok=True)
    line = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(out)]
    mounted = not subprocess.run(line, capture_output=True, check=False).returncode
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(out)], check=True)


def ended(process: Process, words: str, *codes: int) -> list[str]:
    """Wait for the process, which must say `words`, leave with one of `codes`, and show no fault,
    and nothing a terminal obeys.
    """
    streams = process.communicate(timeout=PATIENCE)
    out, err = (stream.decode(errors="surrogateescape") for stream in streams)
    faults = []
    if process.returncode not in codes or words not in err:
        faults.append(f"left with {process.returncode} instead of {codes}, {words!r} expected")
    if "Traceback" in err or "a fault of Panchroma" in err:
        faults.append("a traceback or a fault")
    if _CONTROLS.search(out + err):
        faults.append("control characters")
    return [f"{fault}: {out[-300:]!r} {err[-300:]!r}" for fault in faults]


def _refused(scenario: Scenario, folder: Path, process: Process, words: str) -> list[str]:
    found = ended(process, words, 1, 2) + scenario.faults(folder, finished=False)
    return found + _temporary(folder)


def killed_worker(
    scenario: Scenario, folder: Path, chance: random.Random, seconds: float
) -> list[str]:
    """One of two processes is killed, as for want of memory; then the rest is made."""
    scenario.lay_out(folder)
    process = scenario.start(folder, "--jobs", "2")
    time.sleep(chance.uniform(0.1, seconds))
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    numbers = children.read_text().split() if process.poll() is None else []
    lines = {int(number): Path(f"/proc/{number}/cmdline").read_bytes() for number in numbers}
    workers = [number for number, line in lines.items() if b"spawn_main" in line]
    for worker in workers[:1]:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    err = process.communicate(timeout=PATIENCE)[1].decode()
    failed = err.count("its process was killed")
    made = sum((folder / "out" / name).exists() for name in scenario.outputs)
    faults = scenario.faults(folder, finished=False)
    if process.returncode not in (0, 1, 2) or "Traceback" in err:
        faults.append(f"left with {process.returncode}: {err[-300:]!r}")
    if process.returncode == 1 and (failed != 1 or made != len(scenario.outputs) - 1):
        faults.append(f"{failed} lost, {made} made: {err[-300:]!r}")
    return faults or _again(scenario, folder)


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
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))\n"
    process = scenario.start(folder, script=limit)
    return _refused(scenario, folder, process, "is larger than the file system or a limit")


def read_only(scenario: Scenario, folder: Path) -> list[str]:
    """An output folder that cannot be written to."""
    out = folder / "out"
    with small_disk(folder, 1 << 20) as mounted:
        scenario.lay_out(folder)
        if mounted:
            subprocess.run(["mount", "-o", "remount,ro", str(out)], check=True)
        elif os.geteuid():
            out.chmod(0o500)
        else:
            return []
        return _refused(scenario, folder, scenario.start(folder), "no permission")


def two_at_once(scenario: Scenario, folder: Path) -> list[str]:
    """Two processes that make the same results in one folder: each result must be there,
    complete.
    """
    scenario.lay_out(folder)
    both = [scenario.start(folder), scenario.start(folder)]
    for process in both:
        process.communicate(timeout=PATIENCE)
    codes = (process.returncode for process in both)
    faults = [f"left with {code}" for code in codes if code not in (0, 1)]
    return faults + scenario.faults(folder, finished=True)


def odd_names(scenario: Scenario, folder: Path, **environment: str) -> list[str]:
    """Names with escape sequences, line breaks and bytes that are no text, in a locale."""
    names, words = ("inputs", "outputs", "before"), scenario.arguments
    files: dict[str, Any] = {
        name: {_ODD + path: data for path, data in getattr(scenario, name).items()}
        for name in names
    }
    arguments = tuple(_ODD * (word in scenario.inputs) + word for word in words)
    odd = replace(scenario, arguments=arguments, **files)
    odd.lay_out(folder)
    return _complete(odd, folder, **environment)


def _complete(scenario: Scenario, folder: Path, **environment: str) -> list[str]:
    faults = ended(scenario.start(folder, **environment), "", 0)
    return faults + scenario.faults(folder, finished=True)


def no_place(scenario: Scenario, folder: Path) -> list[str]:
    """No home, and no folder for caches or temporary files."""
    scenario.lay_out(folder)
    names = ("HOME", "TMPDIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
    nowhere = dict.fromkeys(names, _NOWHERE)
    nowhere["NUMBA_CACHE_LOCATOR_CLASSES"] = "UserProvidedCacheLocator"
    return _complete(scenario, folder, **nowhere)


def empty_home(scenario: Scenario, folder: Path) -> list[str]:
    """Nothing is left in the user's home."""
    scenario.lay_out(folder)
    (home := folder / "home").mkdir()
    faults = _complete(scenario, folder, HOME=str(home), XDG_CACHE_HOME="", XDG_CONFIG_HOME="")
    return faults + [f"{path.relative_to(home)} was left in the home" for path in home.rglob("*")]


def ctrl_c(scenario: Scenario, folder: Path, chance: random.Random, seconds: float) -> list[str]:
    """SIGINT for all processes of the command, as a terminal sends it, while worker processes start
    too.
    """
    scenario.lay_out(folder)
    extra = ("--jobs", "4") if scenario.arguments[0] == "render" else ()
    process = scenario.start(folder, *extra)
    time.sleep(chance.uniform(0.1, seconds))
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    faults = ended(process, "", *ENDS[signal.SIGINT])
    return faults + scenario.faults(folder, finished=False)
