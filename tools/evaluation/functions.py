"""Anybody's function for shots of the sparse-colour camera: `FILE.py:FUNCTION`, or
`MODULE:FUNCTION` of a module that Python finds.

It takes a `Mosaic` and returns the picture, an array of floating point (H, W, C), scene units of
the shot: from the samples, or by `panchroma.offline.render` with settings or stages of its own.
"""

import hashlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from functools import cache, partial
from importlib import import_module
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np

from ...shared import FloatArray, InputError, Mosaic
from ...shared.errors import meant
from ..io.display import checked_picture
from .cameras import Method
from .rivals.network import content, printable, read

_TEXT = re.compile(rb"""["']([^"'\n]+)["']""")


def function(text: str) -> Method:
    """Return the method of a function; its name ends with a digest of what it depends on.

    Raises InputError, which names the file or the module, if it cannot be imported or has no such
    function.
    """
    source, _, called = text.rpartition(":")
    with _named(text, source):
        version = hashlib.sha256(f"{_depends(source)} {called}".encode()).hexdigest()[:16]
        module = _module(source, version) if source.endswith(".py") else import_module(source)
        known = {name: value for name, value in vars(module).items() if callable(value)}
        if called not in known:
            raise InputError(f"there is no function {called!r}{meant(called, known)}")
    packages = tuple(sorted({package.name for package in distributions()}))
    name = printable(f"{Path(source).name.removesuffix('.py')}.{called}-{version[:8]}")
    picture = partial(_called, text, getattr(module, "__file__", ""), known[called])
    return Method(name, f"Sparse colour, {name}", picture, version, True, False, packages, text)


def _called(text: str, path: str, call: Callable[[Mosaic], FloatArray], shot: Mosaic) -> FloatArray:
    with _named(text, path):
        picture, expected = call(shot), (*shot.shape, len(shot.calibration.channels))
        if not isinstance(picture, np.ndarray) or picture.shape != expected:
            returned = getattr(picture, "shape", type(picture).__name__)
            raise InputError(f"returned {returned}, expected an array {expected}")
        return checked_picture(picture, expected[2])


@contextmanager
def _named(text: str, path: str) -> Iterator[None]:
    """Turn whatever somebody's code raises into an InputError that names it, and the line of its
    file. What that prints is no record.
    """
    try:
        with redirect_stdout(sys.stderr):
            yield
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f", line {frame.lineno}" for frame in frames if frame.filename == path]
        kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        raise InputError(f"{text}{''.join(lines[-1:])}: {kind}{error}") from error


@cache
def _module(path: str, version: str) -> ModuleType:
    """Return the module in a file. It is compiled from its text: Python's own cache would know it
    by time and size alone.
    """
    module = ModuleType(f"panchroma_function_{version}")
    module.__file__, module.__package__ = path, ""
    sys.modules[module.__name__] = module  # where dataclasses look for it
    exec(compile(Path(path).read_bytes(), path, "exec"), vars(module))
    return module


def _depends(source: str) -> str:
    """Return a digest of the sources in a file's folder, or of a module's package, and of all files
    whose names, relative to the source or to the current folder, are texts in them.
    """
    folders, pattern = [str(Path(source).parent)], "*.py"
    if source.endswith(".py"):
        read(source)  # raises where there is none
    elif spec := find_spec(source.partition(".")[0]):
        package = spec.submodule_search_locations
        folders = list(package or [str(Path(str(spec.origin)).parent)])
        pattern = "**/*.py" if package else "*.py"
    else:
        raise InputError("no such module; give a file that ends with .py, or set PYTHONPATH")
    files = [path for folder in folders for path in Path(folder).glob(pattern) if _is_full(path)]
    for path in files.copy():
        texts = {os.fsdecode(text) for text in _TEXT.findall(path.read_bytes())}
        places = (folder / text for text in texts for folder in (path.parent, Path()))
        files += filter(_is_full, places)
    digests = {(path.name, content(str(path))) for path in files}
    return hashlib.sha256(repr(sorted(digests)).encode()).hexdigest()


def _is_full(path: Path) -> bool:
    return os.path.isfile(path) and os.path.getsize(path) > 0  # noqa: PTH113, PTH202 (Path refuses long texts)
