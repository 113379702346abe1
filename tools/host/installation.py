"""The checks of `panchroma doctor`. Each reports what it finds, and how to repair what is wrong."""

import importlib
import os
import platform
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from shared.errors import PanchromaError
from shared.writing import write_durably

from .compilation import CACHE_REMEDY
from .font_folder import temporary_font_folder
from .memory import available_memory
from .processors import THREAD_VARIABLES, processors
from .versions import package_version, program_version

GOOD, MISSING, BAD = "ok", "missing", "WRONG"
_ALL = "pip install -e '.[all]'"


@dataclass(frozen=True)
class Finding:
    """What one check found.

    name: what was checked.
    state: GOOD, MISSING (something optional is not installed) or BAD.
    found: for people.
    remedy: what to do about it, "" = nothing.
    """

    name: str
    state: str
    found: str
    remedy: str = ""


def _finding(name: str, right: bool, found: str, remedy: str) -> Finding:
    return Finding(name, GOOD if right else BAD, found, "" if right else remedy)


def _program() -> Iterator[Finding]:
    python = platform.python_version()
    yield Finding("Panchroma", GOOD, f"{program_version()} in {Path(__file__).parents[2]}")
    yield _finding("Python", sys.version_info >= (3, 11), f"{python} ({sys.executable})", "use Python 3.11 or newer")


# Distribution, module, oldest version that works, what needs it ("" = everything).
_PACKAGES = (
    ("numpy", "numpy", (2, 0), ""),
    ("tifffile", "tifffile", (2025, 1, 10), ""),
    ("imagecodecs", "imagecodecs", (2024, 12, 30), ""),
    ("onnxruntime", "shared.runtime", (1, 22, 1), ""),
    ("numba", "numba", (0, 61), "render, demo, evaluate, calibrate"),
    ("scipy", "scipy", (1, 14), "render, demo, evaluate, calibrate"),
    ("rawpy", "rawpy", (0, 24), "camera RAWs as scenes"),
    ("Pillow", "PIL", (11,), "JPEG, WebP and PNG scenes"),
    ("OpenEXR", "OpenEXR", (3, 3), "EXR scenes and renders"),
    ("rich", "rich", (13, 7), "progress bars on a terminal"),
    ("colour-demosaicing", "colour_demosaicing", (0, 2, 6), "evaluate: the rivals malvar and menon"),
    ("matplotlib", "matplotlib", (3, 9), "evaluate: colour-demosaicing warns without it"),
    ("bm3d", "bm3d", (4, 0), "evaluate: the rivals with bm3d (non-commercial use only)"),
)


def _packages() -> Iterator[Finding]:
    temporary_font_folder()
    for name, module, least, needed_by in _PACKAGES:
        remedy = "pip install -e '.[rivals]'" if name == "bm3d" else _ALL if needed_by else "pip install -e ."
        state = MISSING if needed_by else BAD
        wanted = ".".join(map(str, least))
        if (found := package_version(name)) is None:
            yield Finding(name, state, f"not installed: {needed_by or 'nothing works without it'}", remedy)
            continue
        if _numbers(found) < least:
            yield Finding(name, BAD, f"{found}, older than {wanted}", f"pip install '{name}>={wanted}'")
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # packages warn about each other
                importlib.import_module(module)
        except Exception as error:  # a broken package may raise anything
            yield Finding(name, BAD, f"{found} cannot be imported: {error}", f"pip install --force-reinstall {name}")
        else:
            yield Finding(name, GOOD, found)


def _numbers(text: str) -> tuple[int, ...]:
    """The leading whole numbers of a version."""
    return tuple(map(int, takewhile(str.isdecimal, text.split("."))))


_OPENCV = ("opencv-python", "opencv-contrib-python", "opencv-python-headless", "opencv-contrib-python-headless")


def _opencv() -> Iterator[Finding]:
    """The OpenCV packages all install the same module, cv2, and so overwrite each other."""
    installed = [f"{name} {found}" for name in _OPENCV if (found := package_version(name))]
    remedy = f"pip uninstall -y {' '.join(each.split()[0] for each in installed)} && pip install {_OPENCV[-1]}"
    if not installed:
        yield Finding("OpenCV", MISSING, "not installed: evaluate (the rival ea), calibrate's search for the chart", _ALL)
    elif len(installed) > 1:
        yield Finding("OpenCV", BAD, f"{' and '.join(installed)} overwrite each other", remedy)
    elif "contrib" not in installed[0]:
        yield Finding("OpenCV", BAD, f"{installed[0]} has no chart detection", remedy)
    else:
        yield Finding("OpenCV", GOOD, installed[0])


def _preview() -> Iterator[Finding]:
    """Run a built-in graph on a grey wall: the picture must be grey too."""
    try:
        import numpy as np

        from device import Preview
        from shared import CfaPattern, SensorCalibration
        from shared.sensor import simulate_additive

        wall = np.full((24, 24, 3), 0.3, np.float32)
        mosaic = simulate_additive(wall, CfaPattern.bayer(6), SensorCalibration(), 0.0, np.random.default_rng(0))
        picture = Preview.for_mosaic(mosaic, threads=1).run(mosaic)
        right = picture.shape == (24, 24, 3) and np.ptp(picture.astype(int)) <= 1
        found = "runs" if right else "makes a wrong picture"
    except Exception as error:  # whatever it is, this check exists to find it
        right, found = False, f"does not run: {error}"
    yield _finding("preview", right, found, "pip install --force-reinstall onnxruntime, then Panchroma")


def _kernels() -> Iterator[Finding]:
    """Numba keeps compiled kernels beside the sources, in NUMBA_CACHE_DIR, or in the user's cache folder."""
    remedy = f"{CACHE_REMEDY}: without it every run compiles again, for a minute"
    try:
        from offline import kernel_cache

        folder = kernel_cache()
    except ModuleNotFoundError:  # reported with the packages
        return
    except RuntimeError:
        yield Finding("kernel cache", BAD, "there is no folder that can be written to", remedy)
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        yield Finding("kernel cache", BAD, f"{folder}: {error.strerror or error}", remedy)
        return
    compiled = len(list(folder.glob("*.nbc")))
    yield Finding("kernel cache", GOOD, f"{folder}, {compiled} compiled" + ("" if compiled else ": the first render does it"))


def _threads() -> Iterator[Finding]:
    usable, cores = processors(), os.cpu_count() or 1
    yield Finding("processors", GOOD, f"{usable} of {cores} may be used")
    for name in THREAD_VARIABLES:
        if (given := os.environ.get(name)) is not None:
            count = int(given) if given.isdecimal() and given.isascii() else 0
            yield _finding(name, 1 <= count <= usable, given, f"unset it, or set 1 to {usable}")


def _memory() -> Iterator[Finding]:
    free = available_memory()
    remedy = "close other programs: a render of 12 megapixels needs about 0.6 GB"
    yield _finding("memory", free >= _LEAST_MEMORY, f"{free / 2**30:.1f} GB free", remedy)


_LEAST_MEMORY = 2**30


def _writing() -> Iterator[Finding]:
    """Write a file as every result is written: a temporary file, fsync, rename."""
    place = os.environ.get("TMPDIR", "the folder for temporary files")
    try:
        place = tempfile.gettempdir()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "written"
            write_durably(path, b"once")
            write_durably(path, b"again", overwrite=True)
            kept = path.read_bytes() == b"again" and len(list(Path(folder).iterdir())) == 1
    except (OSError, PanchromaError) as error:
        yield Finding("writing", BAD, f"{place}: {error}", "free some space there, or set TMPDIR to another folder")
    else:
        remedy = "the file system does not keep what is written; use another"
        yield _finding("writing", kept, f"durable in {place}", remedy)


CHECKS: tuple[Callable[[], Iterator[Finding]], ...] = (
    _program,
    _packages,
    _opencv,
    _preview,
    _kernels,
    _threads,
    _memory,
    _writing,
)
