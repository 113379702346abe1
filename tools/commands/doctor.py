"""Check the installation (versions, missing packages, kernels, memory, writing) and say how to
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
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import partial
from importlib.metadata import PackageNotFoundError, requires
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

from ...shared.errors import DurabilityWarning, PanchromaError
from ...shared.processors import processors
from ...shared.writing import sync_folder, write_durably
from ..batch.compilation import CACHE_REMEDY, compile_all
from ..batch.console import Console
from ..batch.jobs import FAILED
from ..batch.memory import available_memory
from ..io.font_folder import temporary_font_folder
from ..io.versions import package_version, program_version
from .options import add

GOOD, MISSING, BAD = "ok", "missing", "WRONG"
ALL = "pip install -e '.[all]'"
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


def _judged(name: str, right: bool, outcome: str, remedy: str) -> Finding:
    return Finding(name, GOOD, outcome) if right else Finding(name, BAD, outcome, remedy)


def _compiled(console: Console) -> Finding:
    """Compile all kernels that are not in the cache."""
    bad = partial(Finding, "compilation", BAD)
    try:
        from ...offline import kernels_to_compile

        names, start = kernels_to_compile(), time.monotonic()
        with console.progress("doctor") as progress:
            progress.stage("compiling", len(names))
            compiled = compile_all(names, processors(), console.note)
            for number, (kernel, error) in enumerate(compiled, 1):
                if error is not None:
                    return bad(f"{kernel}: {error}", "close other programs, and run it again")
                progress.advance()
                progress.remark(f"compiled kernel {number} of {len(names)}")
        if missing := kernels_to_compile():
            remedy = f"free some disk space, or {CACHE_REMEDY}"
            return bad(f"could not keep {', '.join(missing)}", remedy)
    except ModuleNotFoundError as error:
        return bad(f"needs {error.name}, which is not installed", ALL)
    except RuntimeError:
        return bad("there is no folder to keep compiled kernels in", CACHE_REMEDY)
    took = f"{len(names)} kernels in {time.monotonic() - start:.0f} s"
    return Finding("compilation", GOOD, took if names else "all kernels were compiled already")


def _program() -> Iterator[Finding]:
    yield Finding("Panchroma", GOOD, f"{program_version()} in {Path(__file__).parents[2]}")
    python = f"{platform.python_version()} ({sys.executable})"
    yield _judged("Python", sys.version_info >= (3, 11), python, "use Python 3.11 or newer")


# Extra -> how it is installed, and what needs its packages.
_BM3D = "evaluate: the rivals with bm3d (non-commercial use only)"
_EXTRAS = {
    "": ("pip install -e .", "nothing works without it"),
    "offline": (ALL, "render, demo, evaluate, calibrate"),
    "tools": (ALL, "scenes (camera RAW, JPEG, PNG, EXR), pictures, pages, progress bars"),
    "rivals": ("pip install -e '.[rivals]'", _BM3D),
}
_MODULES = {"onnxruntime": "panchroma.shared.runtime", "Pillow": "PIL"}
_REQUIREMENT = re.compile(r'([\w.-]+) *>= *([\d.]+)(?:.*extra *== *["\']([\w-]+)["\'])?')


def _packages() -> Iterator[Finding]:
    """The packages that pyproject.toml asks for, as the installation knows it."""
    temporary_font_folder()
    try:
        matches = map(_REQUIREMENT.match, requires("panchroma") or ())
    except PackageNotFoundError:
        yield Finding("packages", BAD, "Panchroma is not installed here: they are not known", ALL)
        return
    for name, least, extra in (match.groups(default="") for match in matches if match):
        if extra in _EXTRAS and not name.startswith("opencv"):
            yield _package(name, least, extra)


def _package(name: str, least: str, extra: str) -> Finding:
    remedy, needed_by = _EXTRAS[extra]
    if (version := package_version(name)) is None:
        return Finding(name, MISSING if extra else BAD, f"not installed: {needed_by}", remedy)
    if _numbers(version) < _numbers(least):
        remedy = f"pip install '{name}>={least}'"
        return Finding(name, BAD, f"{version}, older than {least}", remedy)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # packages warn about each other
            importlib.import_module(_MODULES.get(name, name))
    except Exception as error:  # a broken package may raise anything
        remedy = f"pip install --force-reinstall {name}"
        return Finding(name, BAD, f"{version} cannot be imported: {error}", remedy)
    return Finding(name, GOOD, version)


def _numbers(text: str) -> tuple[int, ...]:
    """The leading whole numbers of a version."""
    return tuple(map(int, takewhile(str.isdecimal, text.split("."))))


def _opencv() -> Iterator[Finding]:
    """The OpenCV packages all install the same module, cv2, and so overwrite each other."""
    kinds = "python", "contrib-python", "python-headless", "contrib-python-headless"
    names = [f"opencv-{kind}" for kind in kinds]
    installed = {name: version for name in names if (version := package_version(name))}
    versions = " and ".join(f"{name} {version}" for name, version in installed.items())
    if not installed:
        yield Finding("OpenCV", MISSING, "not installed: burst, calibrate (finding a chart)", ALL)
    elif len(installed) == 1:
        yield Finding("OpenCV", GOOD, versions)
    else:
        remedy = f"pip uninstall -y {' '.join(installed)} && pip install {names[-1]}"
        yield Finding("OpenCV", BAD, f"{versions} overwrite each other", remedy)


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
        right = picture.shape == (24, 24, 3) and np.ptp(picture.astype(int)) <= 1
        outcome = "runs" if right else "makes a wrong picture"
    except Exception as error:  # whatever it is, this check exists to find it
        right, outcome = False, f"does not run: {error}"
    remedy = "pip install --force-reinstall onnxruntime, then Panchroma"
    yield _judged("preview", right, outcome, remedy)


def _kernels() -> Iterator[Finding]:
    remedy = f"{CACHE_REMEDY}: without it every run compiles again, for about half a minute"
    bad = partial(Finding, "kernel cache", BAD, remedy=remedy)
    try:
        from ...offline import kernel_cache

        folder = kernel_cache()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            compiled = len(list(folder.glob("*.nbc")))
    except ModuleNotFoundError:  # reported with the packages
        return
    except RuntimeError:
        yield bad("there is no folder that can be written to")
    except OSError as error:
        yield bad(f"{folder}: {error.strerror or error}")
    else:
        first = "" if compiled else ": the first render does it"
        yield Finding("kernel cache", GOOD, f"{folder}, {compiled} compiled{first}")


def _machine() -> Iterator[Finding]:
    yield Finding("processors", GOOD, f"{processors()} of {os.cpu_count() or 1} may be used")
    free = available_memory()
    remedy = (
        "close other programs, or let the job or the container have more: a render of 12 "
        "megapixels needs about 0.6 GB"
    )
    yield _judged("memory", free >= _LEAST_MEMORY, f"{free / 2**30:.1f} GB free", remedy)


def _writing() -> Iterator[Finding]:
    """Write a file as every result is written: a temporary file, fsync, rename, fsync of the
    folder.
    """
    place = os.environ.get("TMPDIR", "the folder for temporary files")
    try:
        place = tempfile.gettempdir()
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore", DurabilityWarning)
            path = Path(folder) / "written"
            write_durably(path, b"once")
            write_durably(path, b"again", overwrite=True)
            kept = path.read_bytes() == b"again" and len(list(Path(folder).iterdir())) == 1
            durable = sync_folder(Path(folder))
    except (OSError, PanchromaError) as error:
        yield Finding("writing", BAD, f"{place}: {error}", "set TMPDIR to another folder")
    else:
        unsynced = f"whole files in {place}, whose folders cannot be synced"
        remedy = "the file system does not keep what is written; use another"
        yield _judged("writing", kept, f"durable in {place}" if durable else unsynced, remedy)


CHECKS = _program, _packages, _opencv, _preview, _kernels, _machine, _writing
