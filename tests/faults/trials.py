"""What is done to the commands: killed, stopped, without room or permission, two at once. A trial says what it found wrong."""

import os
import random
import resource
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from shared.dng import verify_dng
from shared.errors import PanchromaError
from tests.faults.scenario import Process, Scenario

_PATIENCE = 300.0
_STEPS = 60  # with files, of the longest command; a point beyond the last kills nothing


def interrupted(scenario: Scenario, folder: Path, number: int, chance: random.Random, seconds: float) -> list[str]:
    """The signal `number` at a random step or, as often, at a random time up to `seconds`; then a rerun, which has to finish."""
    scenario.lay_out(folder)
    point = chance.randint(1, _STEPS) if chance.random() < 0.5 else 0
    process = scenario.start(folder, point, number)
    if not point:
        time.sleep(chance.uniform(0.1, seconds))
        process.send_signal(number)
    process.communicate(timeout=_PATIENCE)
    found = _state(scenario, folder, finished=False)
    codes = {signal.SIGKILL: (-9, 0), signal.SIGINT: (130, 0, -2), signal.SIGTERM: (143, 0, -15)}[signal.Signals(number)]
    if process.returncode not in codes:
        found.append(f"left with {process.returncode}")
    if number != signal.SIGKILL and any((folder / "out").glob(".*.part")):
        found.append("left a temporary file")
    if not found:
        found += _again(scenario, folder)
    return found


def _again(scenario: Scenario, folder: Path) -> list[str]:
    """The same command once more makes what is missing, and nothing twice.

    Where one of a scene's two results is there, which may be of other settings, it says so instead; --overwrite makes both.
    """
    whole = {path.name: path.stat().st_ino for path in (folder / "out").iterdir() if not path.name.startswith(".")}
    scenario.start(folder).communicate(timeout=_PATIENCE)
    found = []
    if "--overwrite" not in scenario.arguments:
        now = {path.name: path.stat().st_ino for path in (folder / "out").iterdir()}
        found = [f"{name} was made again" for name, inode in whole.items() if now.get(name) != inode]
        stems = [name.partition(".")[0] for name in whole]
        if any(0 < stems.count(stem) < each for stem, each in _results_of(scenario).items()):
            scenario.start(folder, extra=("--overwrite",)).communicate(timeout=_PATIENCE)
    return found + _state(scenario, folder, finished=True)


def _results_of(scenario: Scenario) -> Counter[str]:
    """How many results each scene or shot has."""
    return Counter(name.partition(".")[0] for name in scenario.outputs)


def _state(scenario: Scenario, folder: Path, *, finished: bool) -> list[str]:
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
    """A file system of `size` bytes at `folder`/out, where that can be had: by root."""
    out = folder / "out"
    line = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(out)]
    mounted = os.geteuid() == 0 and subprocess.run(line, capture_output=True, check=False).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(out)], check=True)


def _refused(scenario: Scenario, folder: Path, process: Process, words: str) -> list[str]:
    _, said = process.communicate(timeout=_PATIENCE)
    found = _state(scenario, folder, finished=False)
    if process.returncode not in (1, 2) or words not in said.decode():
        found.append(f"left with {process.returncode}, and did not say {words!r}: {said.decode()[-300:]}")
    if any((folder / "out").glob(".*.part")):
        found.append("left a temporary file")
    return found


def full_disk(scenario: Scenario, folder: Path, pages: int) -> list[str]:
    """No room for more than so many pages beside what is there."""
    (folder / "out").mkdir(parents=True)
    with small_disk(folder, (pages + len(scenario.before)) * resource.getpagesize()) as mounted:
        if not mounted:
            return []
        for name, data in scenario.inputs.items():
            (folder / name).write_bytes(data)
        for name, data in scenario.before.items():
            (folder / "out" / name).write_bytes(data)
        return _refused(scenario, folder, scenario.start(folder), "the disk is full")


def file_limit(scenario: Scenario, folder: Path, size: int) -> list[str]:
    """No file may be larger than `size` bytes (ulimit -f)."""
    scenario.lay_out(folder)
    process = scenario.start(folder, limit=size)
    return _refused(scenario, folder, process, "is larger than the file system or a limit")


def read_only(scenario: Scenario, folder: Path) -> list[str]:
    """A folder that nothing can be written to."""
    scenario.lay_out(folder)
    out = folder / "out"
    if os.geteuid():
        out.chmod(0o500)
        try:
            return _refused(scenario, folder, scenario.start(folder), "no permission")
        finally:
            out.chmod(0o700)
    with small_disk(folder, 1 << 20) as mounted:
        if not mounted:
            return []
        for name, data in scenario.before.items():
            (out / name).write_bytes(data)
        subprocess.run(["mount", "-o", "remount,ro", str(out)], check=True)
        return _refused(scenario, folder, scenario.start(folder), "no permission")


def two_at_once(scenario: Scenario, folder: Path) -> list[str]:
    """Two processes make the same results in the same folder: each result is there once, whole, and nobody's is lost."""
    scenario.lay_out(folder)
    both = [scenario.start(folder), scenario.start(folder)]
    for process in both:
        process.communicate(timeout=_PATIENCE)
    found = _state(scenario, folder, finished=True)
    return found + [f"left with {process.returncode}" for process in both if process.returncode not in (0, 1)]


def own_input(scenario: Scenario, folder: Path, link: str) -> list[str]:
    """Where a result would go there is an input: itself, or through a symbolic or a hard link."""
    scenario.lay_out(folder)
    for (name, _), output in zip(scenario.inputs.items(), scenario.outputs, strict=False):
        target = folder / "out" / output
        target.unlink(missing_ok=True)
        if link == "symbolic":
            target.symlink_to(folder / name)
        else:
            target.hardlink_to(folder / name)
    process = scenario.start(folder, extra=() if "--overwrite" in scenario.arguments else ("--overwrite",))
    _, said = process.communicate(timeout=_PATIENCE)
    found = [f"{name} was changed" for name, data in scenario.inputs.items() if (folder / name).read_bytes() != data]
    if process.returncode != 1 or said.decode().count("is an input; use another output folder") < 1:
        found.append(f"left with {process.returncode}: {said.decode()[-300:]}")
    return found


def case_alone(scenario: Scenario, folder: Path) -> list[str]:
    """Inputs whose names differ in case alone, which is one name on many disks."""
    scenario.lay_out(folder)
    name, data = next(iter(scenario.inputs.items()))
    other = name.upper().replace(name.rpartition(".")[2].upper(), name.rpartition(".")[2])
    (folder / other).write_bytes(data)
    among = list(scenario.arguments)
    among.insert(among.index(name) + 1, other)
    process = replace(scenario, arguments=tuple(among)).start(folder)
    _, said = process.communicate(timeout=_PATIENCE)
    found = scenario.faults(folder, finished=True)
    if process.returncode != 1 or "the result would have the same name as that of" not in said.decode():
        found.append(f"left with {process.returncode}: {said.decode()[-300:]}")
    return found


@contextmanager
def place() -> Iterator[Path]:
    """A new folder for a trial."""
    with tempfile.TemporaryDirectory(prefix="panchroma-fault-") as folder:
        yield Path(folder) / "world"
