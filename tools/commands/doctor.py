"""Check the installation (versions, missing packages, kernels, memory) and say how to
repair what is wrong.

With --compile, compile the renderer for this processor first, so that no render has to: for
container images and clusters.
"""

import argparse
import importlib
import os
import platform
import re
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import NamedTuple

from ...shared.errors import InputError
from ...shared.processors import processors
from ..batch.compilation import CACHE_REMEDY, compile_all
from ..batch.console import Console
from ..batch.jobs import FAILED
from ..batch.memory import available_memory
from ..batch.parallel import follow, possible_processes
from ..io.versions import install_command, package_version, program_version
from .options import add

GOOD, MISSING, BAD = "ok", "missing", "WRONG"
_LEAST_MEMORY = 2**30

USAGE = ""
EXAMPLE = "panchroma doctor --compile"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma doctor`."""
    compiled = (
        "first compile all of the renderer that is not compiled yet; what is compiled serves this "
        "version of Panchroma on processors of this model, wherever it finds the same cache folder "
        "(the line 'kernel cache' names it)"
    )
    parser.add_argument("--compile", action="store_true", help=compiled)
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Show what every check finds; returns the exit code: 1 when something is wrong, 0 when
    something optional is missing.
    """
    findings = [_compiled(console)] if arguments.compile else []
    findings += [finding for check in CHECKS for finding in check()]
    width = max(len(finding.name) for finding in findings) + 2
    for finding in findings:
        console.say(f"{finding.state:8}{finding.name:{width}}{finding.found}")
        if finding.remedy:
            console.say(f"{'':{width + 8}}-> {finding.remedy}")
        facts = finding._asdict()
        console.record(check=facts.pop("name"), ok=finding.state != BAD, **facts)
    states = Counter(finding.state for finding in findings)
    counted = f"{states[BAD]} wrong, {states[MISSING]} optional things missing"
    console.say(counted if states[BAD] or states[MISSING] else "all is well")
    return FAILED if states[BAD] else 0


# --- the checks: each reports what it finds, and how to repair what is wrong ---------------------


class Finding(NamedTuple):
    """Result of one check.

    Attributes
    ----------
    name : str
        What was checked.
    state : str
        GOOD, MISSING (something optional is not installed) or BAD.
    found : str
        For people.
    remedy : str
        What to do about it, "" = nothing.
    """

    name: str
    state: str
    found: str
    remedy: str = ""


def _compiled(console: Console) -> Finding:
    """Compile all kernels that are not in the cache."""
    try:
        from ...offline import kernels_to_compile

        names, start = kernels_to_compile(), time.monotonic()
        with console.progress("doctor") as progress:
            compiled = compile_all(names, processors(), console.note)
            errors = [error for _, error in follow(compiled, names, progress, "compiling") if error]
        missing = kernels_to_compile()
    except InputError as error:
        return Finding("compilation", BAD, *str(error).split("; "))
    except RuntimeError:
        reason = "there is no folder to keep compiled kernels in"
        return Finding("compilation", BAD, reason, CACHE_REMEDY)
    if missing:
        reason = ": ".join(["not compiled", ", ".join(missing), *map(str, errors[:1])])
        remedy = f"close other programs, free some disk space, or {CACHE_REMEDY}"
        return Finding("compilation", BAD, reason, remedy)
    took = f"{len(names)} kernels in {time.monotonic() - start:.0f} s"
    return Finding("compilation", GOOD, took if names else "all kernels were compiled already")


def _program() -> Iterator[Finding]:
    yield Finding("Panchroma", GOOD, f"{program_version()} in {Path(__file__).parents[2]}")
    yield Finding("Python", GOOD, f"{platform.python_version()} ({sys.executable})")


# Extra -> what needs its packages.
_EXTRAS = {
    "": "nothing works without it",
    "offline": "render, demo, burst, evaluate, calibrate",
    "tools": "scenes (camera RAW, JPEG, PNG, EXR), pictures, pages, progress bars",
    "rivals": "evaluate: the rivals with bm3d (non-commercial use only)",
}
_OPENCV = "opencv-contrib-python-headless"
_OTHERS = "opencv-python", "opencv-contrib-python", "opencv-python-headless"
_MODULES = {
    "onnxruntime": "panchroma.shared.runtime",
    "matplotlib": "panchroma.tools.io.plotting",
    "Pillow": "PIL",
    _OPENCV: "cv2",
}
_REQUIREMENT = re.compile(r'([\w.-]+) *>=(?:.*extra *== *["\']([\w-]+)["\'])?')


def _packages() -> Iterator[Finding]:
    """The packages that pyproject.toml asks for, as the installation knows it."""
    try:
        matches = map(_REQUIREMENT.match, requires("panchroma") or ())
    except PackageNotFoundError:
        reason = "Panchroma is not installed here: they are not known"
        yield Finding("packages", BAD, reason, install_command())
        return
    for name, extra in (match.groups(default="") for match in matches if match):
        if extra in _EXTRAS:
            yield _package(name, extra)
    installed = [name for name in (_OPENCV, *_OTHERS) if package_version(name)]
    if len(installed) > 1:
        reason = f"{' and '.join(installed)} overwrite each other"
        remedy = f"pip uninstall -y {' '.join(installed)} && pip install {_OPENCV}"
        yield Finding("OpenCV", BAD, reason, remedy)


def _package(name: str, extra: str) -> Finding:
    version = package_version(name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # packages warn about each other
            importlib.import_module(_MODULES.get(name, name))
    except Exception as error:  # a broken package may raise anything
        if version:
            denied = isinstance(error, PermissionError)  # told by another check
            remedy = "" if denied else f"pip install --force-reinstall {name}"
            return Finding(name, BAD, f"{version} cannot be imported: {error}", remedy)
        state = MISSING if extra else BAD
        return Finding(name, state, f"not installed: {_EXTRAS[extra]}", install_command(extra))
    return Finding(name, GOOD, version or "installed")


def _preview() -> Iterator[Finding]:
    """Run a graph on a grey wall: the picture must be grey too."""
    try:
        import numpy as np

        from ...shared import CfaPattern, SensorCalibration
        from ..batch.previews import Previews
        from ..simulation.sensor import simulate_additive

        wall, pattern = np.full((24, 24, 3), 0.3, np.float32), CfaPattern.bayer(6)
        sensor, rng = SensorCalibration(), np.random.default_rng(0)
        picture = Previews(threads=1)(simulate_additive(wall, pattern, sensor, 0.0, rng))
        wrong = "" if np.ptp(picture.astype(int)) <= 1 else "makes a wrong picture"
    except Exception as error:  # whatever it is, this check exists to find it
        wrong = f"does not run: {error}"
    remedy = "pip install --force-reinstall onnxruntime, then Panchroma" if wrong else ""
    yield Finding("preview", BAD if wrong else GOOD, wrong or "runs", remedy)


def _kernels() -> Iterator[Finding]:
    try:
        from ...offline import kernel_cache, kernels_to_compile

        folder, missing = kernel_cache(), kernels_to_compile()
    except ModuleNotFoundError:  # reported with the packages
        return
    except InputError as error:  # no machine code
        yield Finding("kernel cache", BAD, *str(error).split("; "))
    except RuntimeError:
        reason = "there is no folder that can be written to: every run compiles for half a minute"
        yield Finding("kernel cache", BAD, reason, CACHE_REMEDY)
    else:
        yield Finding("kernel cache", GOOD, f"{folder}, {len(missing)} kernels to compile")


def _machine() -> Iterator[Finding]:
    yield Finding("processors", GOOD, f"{processors()} of {os.cpu_count() or 1} may be used")
    possible_processes(2, (alone := list[str]()).append)
    remedy = "give the system or the container a folder /dev/shm that can be written to"
    state, found = (MISSING, alone[0]) if alone else (GOOD, "several may share the work")
    yield Finding("processes", state, found, remedy if alone else "")
    free = available_memory()
    scarce = free < _LEAST_MEMORY
    remedy = (
        "close other programs, or let the job or the container have more: a render of 12 "
        "megapixels needs about 0.6 GB"
    )
    found = f"{free / 2**30:.1f} GB free"
    yield Finding("memory", BAD if scarce else GOOD, found, remedy if scarce else "")


CHECKS = _program, _packages, _preview, _kernels, _machine
