"""Scripts in a Python process of their own, with all packages or with those of a camera only."""

import contextlib
import os
import pty
import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path
from typing import Any

from tests.data import ROOT

_HIDE = """
import sys
allowed = set({allowed!r}) | set(sys.stdlib_module_names)
class Hide:
    def find_spec(self, name, path=None, target=None):
        package, _, below = name.partition(".")
        if package not in allowed or (package == "panchroma" and below and below.partition(".")[0] not in {ours!r}):
            raise ModuleNotFoundError(f"No module named {{name!r}}: a camera does not have it", name=name)
sys.meta_path.insert(0, Hide())
"""


def finished(
    *line: str | Path, folder: Path = ROOT, **options: Any
) -> "subprocess.CompletedProcess[str]":
    """A program that has been run to its end in a folder. options: of subprocess.run."""
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False, **options)


def run_python(script: str, *arguments: str | Path, folder: Path = ROOT, **options: Any) -> str:
    """Standard output of a script, which must succeed. folder: where it runs, and finds our
    packages; options: of subprocess.run.
    """
    done = finished(sys.executable, "-c", script, *arguments, folder=folder, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def on_camera(
    script: str,
    *arguments: str,
    ours: tuple[str, ...] = ("shared", "device", "tools"),
    stdin: bytes = b"",
    terminal: bool = False,
) -> subprocess.CompletedProcess[bytes]:
    """A script that is run where every package is hidden but `ours` and the base dependencies.

    terminal: its standard output and error are a terminal, whose text is the output.
    """
    hidden = _HIDE.format(allowed=sorted({*base_modules(), "panchroma"}), ours=ours)
    line = [sys.executable, "-c", hidden + script, *arguments]
    if terminal:
        return _on_terminal(line, stdin)
    return subprocess.run(
        line, input=stdin, cwd=ROOT, capture_output=True, check=False, timeout=120
    )


def _on_terminal(line: list[str], stdin: bytes) -> subprocess.CompletedProcess[bytes]:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=theirs, stderr=theirs, cwd=ROOT)
    os.close(theirs)
    with contextlib.suppress(BrokenPipeError), process.stdin as given:
        given.write(stdin)  # it fits into the pipe
    shown = b""
    with contextlib.suppress(OSError):  # raised by Linux at the end
        while piece := os.read(ours, 4096):
            shown += piece
    os.close(ours)
    return subprocess.CompletedProcess(line, process.wait(120), shown, b"")


def base_modules() -> set[str]:
    """The modules that an installation without extras brings."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = list(project["dependencies"])
    found: set[str] = set()
    while wanted:
        requirement = wanted.pop()
        name = re.split(r"[^\w.-]", requirement)[0].lower().replace("_", "-")
        if name in found or "extra ==" in requirement:
            continue
        try:
            wanted += requires(name) or []
        except PackageNotFoundError:  # needed on another system
            continue
        found.add(name)
    modules = packages_distributions()
    return {
        module
        for module, owners in modules.items()
        if {owner.lower().replace("_", "-") for owner in owners} & found
    }
