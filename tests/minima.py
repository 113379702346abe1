"""Run the tests with the oldest versions of the packages that pyproject.toml declares, and say which of them are installed.

    python -m tests.minima [--python 3.11] [--extra all dev rivals] [pytest's own arguments, tests/shared for instance]

The environment lies in the user's cache and is made anew each time, by uv, which is installed from the package index if need be.
Packages that ours need in turn are the newest that fit. What pytest is given is passed on; without anything it runs all tests.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.data import ROOT

_VERSIONS = "import json, sys; from importlib.metadata import version; print(json.dumps({n: version(n) for n in sys.argv[1:]}))"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code: pytest's, or 2 when the environment cannot be made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default="3.11", metavar="VERSION", help="default: the oldest that is supported, 3.11")
    parser.add_argument("--extra", nargs="+", default=["all", "dev", "rivals"], metavar="NAME", help="default: all dev rivals")
    arguments, passed_on = parser.parse_known_args(argv)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "panchroma-minima"
    try:
        python = _environment(cache, arguments.python, arguments.extra)
        installed = _output([python, "-c", _VERSIONS, *(name for name, _ in minima(arguments.extra))])
    except subprocess.CalledProcessError as error:
        print(f"tests.minima: {' '.join(map(str, error.cmd[:6]))} ...: {error.stderr.strip()}", file=sys.stderr)
        return 2
    found = json.loads(installed)
    for name, declared in minima(arguments.extra):
        newer = "" if _numbers(found[name]) == _numbers(declared) else "   newer than declared"
        print(f"{name} {found[name]}{newer}", flush=True)
    # Numba's cache is one per version: old kernels must not be found beside the sources.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache / "numba")}
    return subprocess.run(
        [python, "-m", "pytest", "-p", "no:cacheprovider", *passed_on], cwd=ROOT, env=environment, check=False
    ).returncode


def minima(extras: Sequence[str]) -> list[tuple[str, str]]:
    """(package, oldest version) of the base and of these extras, each once, by name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return sorted(set(_declared(project, project["dependencies"])) | {each for extra in extras for each in _extra(project, extra)})


def _extra(project: dict[str, Any], name: str) -> Iterator[tuple[str, str]]:
    yield from _declared(project, project["optional-dependencies"][name])


def _declared(project: dict[str, Any], requirements: Sequence[str]) -> Iterator[tuple[str, str]]:
    for requirement in requirements:
        name, _, version = requirement.partition(">=")
        if own := re.fullmatch(r"panchroma\[(.*)\]", name):
            for extra in own[1].split(","):
                yield from _extra(project, extra)
        elif version:
            yield name, version


def _environment(cache: Path, python: str, extras: Sequence[str]) -> Path:
    """The Python of a new environment with the oldest packages, and Panchroma as it lies here."""
    uv = shutil.which("uv") or cache / "uv/bin/uv"
    if not Path(uv).exists():
        _output([sys.executable, "-m", "venv", cache / "uv"])
        _output([cache / "uv/bin/python", "-m", "pip", "install", "--quiet", "uv"])
    shutil.rmtree(cache / "venv", ignore_errors=True)
    _output([uv, "venv", "--quiet", "--python", python, cache / "venv"])
    place = cache / "venv/bin/python"
    options = ("--quiet", "--resolution", "lowest-direct", "--python", place)
    _output([uv, "pip", "install", *options, "--editable", f"{ROOT}[{','.join(extras)}]"])
    return place


def _output(command: Sequence[str | Path]) -> str:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def _numbers(version: str) -> list[str]:
    """The parts of a version without zeros at the end: 2.0 is 2.0.0."""
    return re.sub(r"(\.0)+$", "", version).split(".")


if __name__ == "__main__":
    sys.exit(main())
