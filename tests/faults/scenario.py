"""One command in a folder of its own, whose results are known; and what may be in the folder after
an interruption.

`worlds` returns each command on a few small files, so that it writes often.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import numpy as np

from panchroma.shared import CfaPattern
from panchroma.shared.dng import encode_dng
from panchroma.tools.batch.journal import NAME as JOURNAL
from tests.device.packer import pack, random_codes
from tests.shared.dng.examples import mosaic, preview

_FRAMES = 6

_PROGRAM = "from panchroma.tools.cli import main; main()"
# Counts the program's operations on files below a folder, and kills it before the N-th: wherever a
# file may be incomplete.
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
    """A command and the files around it.

    arguments: the command line, with paths relative to the scenario's folder.
    inputs: name -> content of the originals, which nothing may change.
    outputs: name -> digest of the complete result; empty where the results' names are not known.
    before: name -> content of a result that exists before the command starts (with --overwrite).
    stdin: standard input.
    """

    name: str
    arguments: tuple[str, ...]
    inputs: Mapping[str, bytes]
    outputs: Mapping[str, str]
    before: Mapping[str, bytes]
    stdin: bytes = b""

    def lay_out(self, folder: Path) -> None:
        """Write all that exists before the command."""
        (folder / "out").mkdir(parents=True, exist_ok=True)
        for name, data in self.inputs.items():
            (folder / name).write_bytes(data)
        for name, data in self.before.items():
            (folder / "out" / name).write_bytes(data)

    def start(
        self,
        folder: Path,
        point: int = 0,
        number: int = 9,
        extra: Sequence[str] = (),
        limit: int = 0,
        environment: Mapping[str, str] | None = None,
        group: bool = False,
    ) -> Process:
        """Start the command, with `extra` arguments.

        point: it receives the signal `number` at its `point`-th operation on files; 0: never.
        limit: the largest file it may write, bytes; 0: any.
        environment: variables that replace those of this process.
        group: it leads a group of processes of its own.
        """
        limited = (
            f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))\n"
            if limit
            else ""
        )
        script = limited + (_KILLED if point else "") + _PROGRAM
        killing = [str(folder / "out"), str(point)] if point else []
        feed = folder / "stdin"
        feed.write_bytes(self.stdin)
        variables = {**os.environ, "FAULT_SIGNAL": str(number), **(environment or {})}
        with feed.open("rb") as stdin:
            return subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    script,
                    *killing,
                    self.arguments[0],
                    *extra,
                    *self.arguments[1:],
                ],
                cwd=folder,
                stdin=stdin,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=variables,
                start_new_session=group,
            )

    def faults(self, folder: Path, *, finished: bool) -> list[str]:
        """What is wrong in the folder, a line each. finished: every result must be there, and
        nothing else.
        """
        found = [
            f"{name} was changed"
            for name, data in self.inputs.items()
            if (folder / name).read_bytes() != data
        ]
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
        strangers = [
            name
            for name in present
            if finished or not name.endswith((".panchroma.part", ".panchroma.lock"))
        ]
        return found + [f"{name} was left behind" for name in strangers]


def digest(data: bytes) -> str:
    """SHA-256 of a result, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def known(
    name: str, arguments: Sequence[str], inputs: Mapping[str, bytes], folder: Path
) -> Scenario:
    """The scenario whose expected results are those of an undisturbed run in `folder`."""
    scenario = Scenario(name, tuple(arguments), inputs, {}, {})
    scenario.lay_out(folder)
    process = scenario.start(folder)
    _, said = process.communicate(timeout=300)
    if process.returncode:
        raise RuntimeError(f"{name}: {said.decode()}")
    outputs = {
        path.name: digest(path.read_bytes())
        for path in (folder / "out").iterdir()
        if path.name != JOURNAL
    }
    return replace(scenario, outputs=outputs)


def replacing(scenario: Scenario) -> Scenario:
    """The scenario in which older results exist and --overwrite replaces them."""
    before = {name: f"an older {name}".encode() for name in scenario.outputs}
    return replace(
        scenario,
        name=f"{scenario.name} --overwrite",
        arguments=(*scenario.arguments, "--overwrite"),
        before=before,
    )


def worlds(folder: Path) -> list[Scenario]:
    """simulate, render and capture; the first two also over older results. folder: for an
    undisturbed run of each.
    """
    return [*pictures(folder), capture()]


def pictures(folder: Path) -> list[Scenario]:
    """simulate and render, with and without older results."""
    pattern = CfaPattern.bayer(6)
    shots = {
        f"shot{each}.dng": encode_dng(mosaic(pattern, (60, 80 + each)), preview(24, 32))
        for each in range(4)
    }
    scenes = {f"scene{number}.npy": scene(number) for number in range(4)}
    # Without noise, which would depend on the names of the shots.
    simulate = known(
        "simulate", ["simulate", *scenes, "-o", "out", "--truth"], scenes, folder / "simulate"
    )
    render = known("render", ["render", *shots, "-o", "out"], shots, folder / "render")
    return [simulate, replacing(simulate), render, replacing(render)]


def capture() -> Scenario:
    """capture of a recording. Results are named after the time, so that only their completeness can
    be checked.
    """
    frames = b"".join(pack(random_codes((24, 32), 10, seed), "raw10") for seed in range(_FRAMES))
    layout = ["--size", "32x24", "--pixel-format", "raw10"]
    return Scenario("capture", ("capture", "-", "-o", "out", *layout), {}, {}, {}, frames)


def scene(number: int) -> bytes:
    """A linear picture, as a file in NPY format."""
    file = BytesIO()
    np.save(file, np.random.default_rng(number).random((60, 80, 3)).astype(np.float32))
    return file.getvalue()
