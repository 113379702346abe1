"""What `panchroma doctor` looks at. Each check says what it found, and what to do where that is not right."""

import importlib
import os
import platform
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from shared.errors import PanchromaError
from shared.writing import write_durably

from .memory import available_memory
from .processors import THREAD_VARIABLES, processors
from .versions import program_version

GOOD, MISSING, BAD = "ok", "missing", "WRONG"
_ALL = "pip install -e '.[all]'"


@dataclass(frozen=True)
class Finding:
    """What one look has shown. state: GOOD, MISSING (a command that is not needed lacks something) or BAD; remedy: "" = none."""

    name: str
    state: str
    found: str
    remedy: str = ""


def _program() -> Iterator[Finding]:
    python = platform.python_version()
    yield Finding("Panchroma", GOOD, f"{program_version()} in {Path(__file__).parents[2]}")
    old = sys.version_info < (3, 11)
    yield Finding("Python", BAD if old else GOOD, f"{python} ({sys.executable})", "use Python 3.11 or newer" if old else "")


# Distribution, module, oldest version that will do, what misses it ("" = everything).
_PACKAGES = (
    ("numpy", "numpy", (2, 0), ""),
    ("tifffile", "tifffile", (2025, 1, 10), ""),
    ("imagecodecs", "imagecodecs", (2024, 12, 30), ""),
    ("onnxruntime", "onnxruntime", (1, 22, 1), ""),
    ("numba", "numba", (0, 61), "render, demo, evaluate, calibrate"),
    ("scipy", "scipy", (1, 14), "render, demo, evaluate, calibrate"),
    ("onnx", "onnx", (1, 17), "export-preview, previews of unusual patterns"),
    ("rawpy", "rawpy", (0, 24), "camera RAWs as scenes"),
    ("Pillow", "PIL", (11,), "JPEG, WebP and PNG scenes"),
    ("OpenEXR", "OpenEXR", (3, 3), "EXR scenes and renders"),
    ("rich", "rich", (13, 7), "progress bars on a terminal"),
    ("colour-demosaicing", "colour_demosaicing", (0, 2, 6), "evaluate: the rivals malvar and menon"),
    ("matplotlib", "matplotlib", (3, 9), "evaluate: colour-demosaicing warns without it"),
    ("bm3d", "bm3d", (4, 0), "evaluate: the rivals with bm3d (non-commercial use only)"),
)


def _packages() -> Iterator[Finding]:
    for name, module, least, needed_by in _PACKAGES:
        remedy = "pip install -e '.[rivals]'" if name == "bm3d" else _ALL if needed_by else "pip install -e ."
        state = MISSING if needed_by else BAD
        wanted = ".".join(map(str, least))
        try:
            found = version(name)
        except PackageNotFoundError:
            yield Finding(name, state, f"not installed: {needed_by or 'nothing works without it'}", remedy)
            continue
        if _numbers(found) < least:
            yield Finding(name, BAD, f"{found}, older than {wanted}", f"pip install '{name}>={wanted}'")
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of packages about packages
                importlib.import_module(module)
        except Exception as error:  # a broken package may raise anything
            yield Finding(name, BAD, f"{found} cannot be imported: {error}", f"pip install --force-reinstall {name}")
        else:
            yield Finding(name, GOOD, found)


def _numbers(text: str) -> tuple[int, ...]:
    """The leading whole numbers of a version."""
    numbers: list[int] = []
    for part in text.split("."):
        if not part.isdecimal():
            break
        numbers.append(int(part))
    return tuple(numbers)


_OPENCV = ("opencv-python", "opencv-contrib-python", "opencv-python-headless", "opencv-contrib-python-headless")


def _opencv() -> Iterator[Finding]:
    """They all install the same module, cv2, one over the other."""
    installed = []
    for name in _OPENCV:
        try:
            installed.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    wanted = _OPENCV[-1]
    if not installed:
        yield Finding("OpenCV", MISSING, "not installed: evaluate (the rival ea), calibrate's search for the chart", _ALL)
    elif len(installed) > 1:
        remedy = f"pip uninstall -y {' '.join(each.split()[0] for each in installed)} && pip install {wanted}"
        yield Finding("OpenCV", BAD, f"{' and '.join(installed)} overwrite each other", remedy)
    elif "contrib" not in installed[0]:
        remedy = f"pip uninstall -y {installed[0].split()[0]} && pip install {wanted}"
        yield Finding("OpenCV", BAD, f"{installed[0]} has no chart detection", remedy)
    else:
        yield Finding("OpenCV", GOOD, installed[0])


def _preview() -> Iterator[Finding]:
    """A graph that came with the package, over a grey wall: the picture has to be one too."""
    try:
        import numpy as np

        from device import Preview
        from shared import CfaPattern, SensorCalibration
        from shared.sensor import simulate_additive

        wall = np.full((24, 24, 3), 0.3, np.float32)
        mosaic = simulate_additive(wall, CfaPattern.bayer(6), SensorCalibration(), 0.0, np.random.default_rng(0))
        picture = Preview.for_mosaic(mosaic, threads=1).run(mosaic)
    except Exception as error:  # whatever it is, it is what the doctor was asked for
        yield Finding("preview", BAD, f"does not run: {error}", "pip install --force-reinstall onnxruntime, then Panchroma")
    else:
        right = picture.shape == (24, 24, 3) and np.ptp(picture.astype(int)) <= 1
        remedy = "" if right else "pip install --force-reinstall onnxruntime, then Panchroma"
        yield Finding("preview", GOOD if right else BAD, "runs" if right else "makes a wrong picture", remedy)


def _kernels() -> Iterator[Finding]:
    """Numba keeps compiled kernels beside the sources, or where NUMBA_CACHE_DIR says, or in the user's cache."""
    remedy = "set NUMBA_CACHE_DIR to a folder that you may write to: without it every run compiles again, for a minute"
    try:
        from offline import kernel_cache

        folder = kernel_cache()
    except ModuleNotFoundError:  # said among the packages
        return
    except Exception as error:  # Numba finds no place for its cache
        yield Finding("kernel cache", BAD, f"{error}", remedy)
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
        if name not in os.environ:
            continue
        given = os.environ[name]
        count = int(given) if given.isdecimal() and given.isascii() else 0
        state = GOOD if 1 <= count <= usable else BAD
        yield Finding(name, state, given, "" if state == GOOD else f"unset it, or set 1 to {usable}")


def _memory() -> Iterator[Finding]:
    free = available_memory()
    small = free < _LEAST_MEMORY
    remedy = "close other programs: a render of 12 megapixels needs about 0.6 GB" if small else ""
    yield Finding("memory", BAD if small else GOOD, f"{free / 2**30:.1f} GB free", remedy)


_LEAST_MEMORY = 2**30


def _writing() -> Iterator[Finding]:
    """As every result is written: a temporary file, fsync, and a new name."""
    place = tempfile.gettempdir()
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "written"
            write_durably(path, b"once")
            write_durably(path, b"again", overwrite=True)
            kept = path.read_bytes() == b"again" and len(list(Path(folder).iterdir())) == 1
    except (OSError, PanchromaError) as error:
        yield Finding("writing", BAD, f"{place}: {error}", "free some space there, or set TMPDIR to another folder")
    else:
        remedy = "" if kept else "the file system does not keep what is written; use another"
        yield Finding("writing", GOOD if kept else BAD, f"durable in {place}", remedy)


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
