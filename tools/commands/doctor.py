"""Check the installation (versions, missing packages, kernels, memory) and say how to
repair what is wrong.

It renders tiny pictures, and compiles all of the renderer that is not compiled yet, so that no
render has to. What is compiled serves this version of Panchroma on processors of this model,
wherever it finds the same cache folder (the line 'kernel cache' names it): in container images, on
clusters.
"""

import argparse
import importlib
import os
import platform
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from importlib.metadata import requires
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...shared.processors import processors
from ..batch.compilation import compile_all
from ..batch.console import Console
from ..batch.jobs import FAILED
from ..batch.memory import available_memory
from ..batch.parallel import follow, possible_processes
from ..io.versions import install_command, package_version, program_version
from .options import add

if TYPE_CHECKING:
    from ...shared import Mosaic

GOOD, MISSING, BAD = "ok", "missing", "WRONG"
_LEAST_MEMORY = 2**30

USAGE = ""
EXAMPLE = "panchroma doctor"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma doctor`."""
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Show what every check finds; returns the exit code: 1 when something is wrong, 0 when
    something optional is missing.
    """
    program = f"{program_version()} in {Path(__file__).parents[2]}"
    python = Finding("Python", GOOD, f"{platform.python_version()} ({sys.executable})")
    findings = [Finding("Panchroma", GOOD, program), python, *_checked("packages", _packages)]
    findings += _checked("kernel cache", partial(_kernels, console))
    for name, check in _pictures().items():
        findings += _checked(name, check)
    findings += _machine()
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


def _checked(name: str, check: Callable[[], Iterable[Finding] | None]) -> Iterator[Finding]:
    """Yield what a check finds, or that it runs; what it raises is a finding, too."""
    try:
        yield from check() or [Finding(name, GOOD, "runs")]
    except ModuleNotFoundError as error:
        yield Finding(name, MISSING, f"needs the package {error.name}", install_command())
    except Exception as error:  # a broken package may raise anything, and checks are to find it
        reason, _, remedy = str(error).partition("; ")
        again = install_command().replace("install", "install --force-reinstall", 1)
        yield Finding(name, BAD, f"does not run: {reason}", remedy or again)


# Extras of pyproject.toml whose packages are looked at; "" = what nothing works without.
_EXTRAS = "", "offline", "tools", "rivals"
_OPENCV = "opencv-contrib-python-headless"
_OTHER_OPENCV = "opencv-python", "opencv-contrib-python", "opencv-python-headless"
# Package -> what is imported to try it, where that has another name, or is our own import of it.
_OWN = {"onnxruntime": "panchroma.shared.runtime", "matplotlib": "panchroma.tools.io.plotting"}
_MODULES = {**_OWN, "Pillow": "PIL", _OPENCV: "cv2"}


def _packages() -> Iterator[Finding]:
    """The packages that pyproject.toml asks for, as the installation knows it."""
    from packaging.requirements import Requirement

    for one in map(Requirement, requires("panchroma") or ()):
        marker = one.marker
        extras = [name for name in _EXTRAS if not marker or marker.evaluate({"extra": name})]
        if extras and one.name != "panchroma":
            yield _package(one.name, one.specifier, extras[0])
    installed = [name for name in (_OPENCV, *_OTHER_OPENCV) if package_version(name)]
    if len(installed) > 1:
        reason = f"{' and '.join(installed)} overwrite each other"
        remedy = f"pip uninstall -y {' '.join(installed)} && pip install {_OPENCV}"
        yield Finding("OpenCV", BAD, reason, remedy)


def _package(name: str, wanted: Any, extra: str) -> Finding:
    """A package, of which the versions `wanted` will do."""
    if (version := package_version(name)) and not wanted.contains(version, prereleases=True):
        reason = f"{version} is installed, {wanted} is needed"
        return Finding(name, BAD, reason, f"pip install '{name}{wanted}'")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # packages warn about each other
            importlib.import_module(_MODULES.get(name, name))
    except Exception as error:  # a broken package may raise anything
        if version:
            reason = f"{version} cannot be imported: {error}"
            return Finding(name, BAD, reason, f"pip install --force-reinstall {name}")
        reason = f"not installed, belongs to panchroma{extra and f'[{extra}]'}"
        return Finding(name, MISSING if extra else BAD, reason, install_command(extra))
    return Finding(name, GOOD, version or "installed")


def _kernels(console: Console) -> Iterator[Finding]:
    """Compile the kernels that are not in the cache."""
    from ...offline import kernel_cache, kernels_to_compile

    importlib.import_module("panchroma.offline.burst")  # has kernels of its own
    folder, names = kernel_cache(), kernels_to_compile()
    with console.progress("doctor") as progress:
        compiled = compile_all(names, processors(), console.note)
        errors = [error for _, error in follow(compiled, names, progress, "compiling") if error]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    found, remedy = f"{folder}, {len(names)} compiled", ""
    if missing := kernels_to_compile():
        found = ": ".join(["not compiled", ", ".join(missing), *map(str, errors[:1])])
        remedy = "close other programs, free some disk space, or set NUMBA_CACHE_DIR"
    elif chosen and not folder.is_relative_to(Path(chosen).absolute()):
        found = f"{chosen} cannot be written to; kernels are in {folder}"
        remedy = "set NUMBA_CACHE_DIR to a folder that you may write to, or unset it"
    yield Finding("kernel cache", BAD if remedy else GOOD, found, remedy)


def _pictures() -> dict[str, Callable[[], None]]:
    """Checks that open all networks (a camera has none), and that make pictures of a grey wall in
    each way.
    """
    checks: dict[str, Callable[[], None]] = {"networks": _open_networks, "preview": _preview}
    with suppress(Exception):  # reported with the kernels
        from ...offline import PRESETS

        checks |= {f"render, {name}": partial(_render, kind) for name, kind in PRESETS.items()}
    return checks


def _open_networks() -> None:
    from ...shared.networks import NETWORKS, load_network

    for path in NETWORKS.glob("*.onnx"):
        load_network(path)


def _preview() -> None:
    from ..batch.in_memory import camera_preview

    _check_grey(camera_preview(_wall(), threads=1))


def _render(settings: Any) -> None:
    from ...offline import render

    _check_grey(render(_wall(), settings).rgb)


def _wall() -> "Mosaic":
    import numpy as np

    from ...shared import CfaPattern, SensorCalibration
    from ..simulation.sensor import simulate_additive

    wall, rng = np.full((24, 24, 3), 0.3, np.float32), np.random.default_rng(0)
    return simulate_additive(wall, CfaPattern.bayer(6), SensorCalibration(), 0.0, rng)


def _check_grey(picture: Any) -> None:
    if not picture.max() - picture.min() < 0.02 * picture.max():
        raise ValueError("it makes a wrong picture")


def _machine() -> Iterator[Finding]:
    yield Finding("processors", GOOD, f"{processors()} of {os.cpu_count() or 1} may be used")
    possible_processes(2, (alone := list[str]()).append)
    remedy = "give the system or the container a folder /dev/shm that can be written to"
    state, found = (MISSING, alone[0]) if alone else (GOOD, "several may share the work")
    yield Finding("processes", state, found, remedy if alone else "")
    free = available_memory()
    scarce = free < _LEAST_MEMORY
    need = "a render of 12 megapixels needs about 0.6 GB"
    remedy = f"close other programs, or let the job or the container have more: {need}"
    found = f"{free / 2**30:.1f} GB free"
    yield Finding("memory", BAD if scarce else GOOD, found, remedy if scarce else "")
