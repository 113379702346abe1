"""One command in a folder of its own, whose results are known: what may be there after whatever has happened to it."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from tests.data import ROOT
from tools.rendering.journal import NAME as JOURNAL

_PROGRAM = "from tools.cli import main; main()"
# Counts what the program does to files under a folder, and kills it before the N-th: at each place where a file may be half done.
_KILLED = """
import os, signal, sys
folder, point = sys.argv.pop(1), int(sys.argv.pop(1))
count = 0
def step(*_):
    global count
    count += 1
    if count == point:
        os.kill(os.getpid(), int(os.environ["FAULT_SIGNAL"]))
def heard(event, arguments):
    if event in ("open", "os.link", "os.rename", "os.remove", "os.symlink") and any(folder in str(part) for part in arguments):
        step()
fsync = os.fsync
def synced(descriptor):
    step()
    fsync(descriptor)
    step()
os.fsync = synced
sys.addaudithook(heard)
"""


Process: TypeAlias = "subprocess.Popen[bytes]"


@dataclass(frozen=True)
class Scenario:
    """A command and its world.

    arguments: of the command, relative to its folder. inputs: names of originals, which nothing may touch. outputs: name -> digest
    of the whole result. before: name -> content that was there when it began (with --overwrite). stdin: of the command.
    """

    name: str
    arguments: tuple[str, ...]
    inputs: Mapping[str, bytes]
    outputs: Mapping[str, str]
    before: Mapping[str, bytes]
    stdin: bytes = b""

    def lay_out(self, folder: Path) -> None:
        """The world before the command."""
        (folder / "out").mkdir(parents=True)
        for name, data in self.inputs.items():
            (folder / name).write_bytes(data)
        for name, data in self.before.items():
            (folder / "out" / name).write_bytes(data)

    def start(self, folder: Path, point: int = 0, number: int = 9, extra: Sequence[str] = (), limit: int = 0) -> Process:
        """The command at work, with `extra` arguments.

        It gets the signal `number` at its `point`-th step with files, 0 = never; it may write files of `limit` bytes, 0 = any.
        """
        limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))\n" if limit else ""
        script = limited + (_KILLED if point else "") + _PROGRAM
        told = [str(folder / "out"), str(point)] if point else []
        feed = folder / "stdin"
        feed.write_bytes(self.stdin)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "FAULT_SIGNAL": str(number)}
        with feed.open("rb") as stdin:
            return subprocess.Popen(
                [sys.executable, "-c", script, *told, self.arguments[0], *extra, *self.arguments[1:]],
                cwd=folder,
                stdin=stdin,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                env=environment,
            )

    def faults(self, folder: Path, *, finished: bool) -> list[str]:
        """What is wrong in the folder now; finished: every result has to be there, and nothing else."""
        found = [f"{name} was changed" for name, data in self.inputs.items() if (folder / name).read_bytes() != data]
        present = {path.name: path for path in (folder / "out").iterdir() if path.name != JOURNAL}
        for name, expected in self.outputs.items():
            path = present.pop(name, None)
            if path is None:
                if finished or name in self.before:
                    found.append(f"{name} is missing")
                continue
            content = path.read_bytes()
            if digest(content) != expected and (finished or content != self.before.get(name)):
                found.append(f"{name} is neither old nor new ({len(content)} bytes)")
        strangers = [name for name in present if finished or not name.endswith((".panchroma.part", ".panchroma.lock"))]
        return found + [f"{name} was left behind" for name in strangers]


def digest(data: bytes) -> str:
    """Of a result."""
    return hashlib.sha256(data).hexdigest()


def known(name: str, arguments: Sequence[str], inputs: Mapping[str, bytes], folder: Path, stdin: bytes = b"") -> Scenario:
    """The scenario whose results are what the command makes undisturbed."""
    scenario = Scenario(name, tuple(arguments), inputs, {}, {}, stdin)
    scenario.lay_out(folder)
    process = scenario.start(folder)
    _, said = process.communicate(timeout=300)
    if process.returncode:
        raise RuntimeError(f"{name}: {said.decode()}")
    outputs = {path.name: digest(path.read_bytes()) for path in (folder / "out").iterdir() if path.name != JOURNAL}
    return Scenario(name, tuple(arguments), inputs, outputs, {}, stdin)


def replacing(scenario: Scenario) -> Scenario:
    """The same where older results are there, and are to be replaced."""
    before = {name: f"an older {name}".encode() for name in scenario.outputs}
    return replace(scenario, name=f"{scenario.name} --overwrite", arguments=(*scenario.arguments, "--overwrite"), before=before)
