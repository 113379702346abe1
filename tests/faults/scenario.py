"""One command in a folder of its own, whose results are known; and what may be in the folder after
an interruption.

`worlds` returns each command on a few small files, so that it writes often.
"""

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from subprocess import PIPE, Popen
from typing import TypeAlias

import numpy as np

from panchroma.shared.dng import encode_dng, verify_dng
from panchroma.shared.errors import PanchromaError
from panchroma.tools.batch.journal import NAME as JOURNAL
from tests.device.packer import pack, random_codes
from tests.shared.dng.examples import mosaic, preview
from tests.tools.command import SCRIPT

_FRAMES = 6
Process: TypeAlias = Popen[bytes]


@dataclass(frozen=True)
class Scenario:
    """A command and the files around it.

    arguments: the command line, with paths relative to the scenario's folder.
    inputs: name -> content of the originals, which nothing may change.
    outputs: name -> the complete result; empty where the results' names are not known.
    before: name -> content of a result that exists before the command starts (with --overwrite).
    stdin: standard input.
    """

    name: str
    arguments: tuple[str, ...]
    inputs: Mapping[str, bytes]
    outputs: Mapping[str, bytes]
    before: Mapping[str, bytes]
    stdin: bytes = b""

    def lay_out(self, folder: Path) -> None:
        """Write all that exists before the command."""
        (folder / "out").mkdir(parents=True, exist_ok=True)
        (folder / "stdin").write_bytes(self.stdin)
        for name, data in self.inputs.items():
            (folder / name).write_bytes(data)
        for name, data in self.before.items():
            (folder / "out" / name).write_bytes(data)

    def start(self, folder: Path, *extra: str, script: str = "", **environment: str) -> Process:
        """Start the command, with `extra` arguments, in a group of processes of its own.

        script: what its process runs first.
        environment: variables that replace those of this process.
        """
        verb, *arguments = self.arguments
        line = [sys.executable, "-c", script + SCRIPT, verb, *extra, *arguments]
        env = {**os.environ, **environment}
        with (folder / "stdin").open("rb") as feed:
            return Popen(
                line, cwd=folder, stdin=feed, stdout=PIPE, stderr=PIPE, env=env, process_group=0
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
            if content != expected and (finished or content != self.before.get(name)):
                found.append(f"{name} is neither old nor new ({len(content)} bytes)")
        for name, path in present.items():
            if not finished and name.endswith((".panchroma.part", ".panchroma.lock")):
                continue
            if self.outputs:
                found.append(f"{name} was left behind")
                continue
            try:
                verify_dng(path)
            except PanchromaError as error:
                found.append(str(error))
        return found


def known(inputs: Mapping[str, bytes], folder: Path, verb: str, *options: str) -> Scenario:
    """The scenario whose expected results are those of an undisturbed run in `folder`."""
    scenario = Scenario(verb, (verb, *inputs, "-o", "out", *options), inputs, {}, {})
    scenario.lay_out(folder)
    process = scenario.start(folder)
    _, said = process.communicate(timeout=300)
    if process.returncode:
        raise RuntimeError(f"{verb}: {said.decode()}")
    paths = [path for path in (folder / "out").iterdir() if path.name != JOURNAL]
    return replace(scenario, outputs={path.name: path.read_bytes() for path in paths})


def replacing(scenario: Scenario) -> Scenario:
    """The scenario in which older results exist and --overwrite replaces them."""
    return replace(
        scenario,
        name=f"{scenario.name} --overwrite",
        arguments=(*scenario.arguments, "--overwrite"),
        before={name: f"an older {name}".encode() for name in scenario.outputs},
    )


def worlds(folder: Path) -> list[Scenario]:
    """simulate, render and capture; the first two also over older results. folder: for an
    undisturbed run of each.
    """
    shots = {
        f"shot{each}.dng": encode_dng(mosaic(shape=(60, 80 + each)), preview(24, 32))
        for each in range(4)
    }
    scenes = {f"scene{number}.npy": scene(number) for number in range(4)}
    # Without noise, which would depend on the names of the shots.
    simulate = known(scenes, folder / "simulate", "simulate", "--truth")
    render = known(shots, folder / "render", "render")
    # A recording. Results are named after the time: only their completeness can be checked.
    frames = b"".join(pack(random_codes((24, 32), 10, seed), "raw10") for seed in range(_FRAMES))
    recording = ("capture", "-", "-o", "out", "--size", "32x24", "--pixel-format", "raw10")
    capture = Scenario("capture", recording, {}, {}, {}, frames)
    return [simulate, replacing(simulate), render, replacing(render), capture]


def scene(number: int) -> bytes:
    """A linear picture, as a file in NPY format."""
    file = BytesIO()
    np.save(file, np.random.default_rng(number).random((60, 80, 3)).astype(np.float32))
    return file.getvalue()
