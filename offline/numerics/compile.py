"""Kernels: loops compiled by Numba, once per machine, that run in threads; and their cache on the
disk.

Kernels are compiled for the types that their annotations name. Machine code contains constants and
functions of other files and depends on the processor, the versions and Numba's settings: a digest
of all of these names the folder in which a kernel is kept, one file for each.

Only public interfaces of Numba are used. It reads and writes machine code in a temporary folder,
which `numba.config` names only while a function is prepared.
"""

import hashlib
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from inspect import signature
from pathlib import Path
from shutil import make_archive, rmtree, unpack_archive
from tempfile import TemporaryDirectory
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, get_args, get_type_hints

import numba
import numpy as np
from llvmlite import binding
from numba import types
from numba.extending import register_jitable

from ...shared.arrays import Pair
from ...shared.errors import OutputError
from ...shared.processors import threads
from ...shared.source import code_digest
from ...shared.writing import write_durably
from .chunks import in_chunks

F = TypeVar("F", bound=Callable[..., Any])
P = ParamSpec("P")

# Fused multiply-add, but nothing that changes the order of a sum: a kernel's result must not depend
# on where a row begins.
_OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
_OPTIONS["no_cfunc_wrapper"] = True  # no C program calls them
_compiling = threading.Lock()
_listeners: ContextVar[tuple[Callable[[int, int], None], ...]] = ContextVar("listeners", default=())

Chunks = Pair
"""First chunk and end, which every kernel takes before all other arguments: what it computes in one
call.
"""

ZERO, ONE = np.float32(0), np.float32(1)
"""Numbers of kernels: Python's own would make an expression double precision."""
LITTLE = 1 << 15
"""A kernel none of whose arrays has more elements runs in the thread that calls it: to wake others
costs more than it saves.
"""
# Elements of the largest array per call: some milliseconds, and tenths of a second for the slowest
# kernels.
_TOGETHER = 1 << 18

_SEEN = Path(__file__).parents[2], "offline/**/*.py", "shared/arrays.py"  # by kernels
_SOURCE = code_digest(*_SEEN)  # before modules with kernels are imported
# The folder that the user has chosen, and the other kinds of folder: "" = none, and all.
_CHOSEN, _LOCATORS = numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES
# Sources, processors and settings of which a folder keeps kernels, some megabytes each: those that
# were compiled last.
_VERSIONS = 16
# Of files that are kept, seconds: an archive holds none of before 1980, which a camera may have.
_TIME = 1e9


class ParallelKernel(Generic[P]):
    """A function that stages call. It is compiled, or read from the disk, when it is first called,
    for the types it names alone.

    Arguments of other types are converted if that is possible: an array that may be written can
    stand for one that may not, but float64 never for float32. Otherwise a call raises TypeError.
    """

    def __init__(
        self, function: Callable[Concatenate[Chunks, P], None], chunks: Callable[..., int]
    ) -> None:
        self.function, self._chunks = function, chunks
        self.compiled: Callable[..., None] | None = None  # in this process

    def __call__(self, *arguments: P.args, **_: P.kwargs) -> None:
        """Compute all chunks, in `threads()` threads."""
        compiled, chunks = self.compile(), self._chunks(*arguments)
        largest = _largest(arguments)
        together = max(1, min(chunks * _TOGETHER // max(largest, 1), -(-chunks // (2 * threads()))))
        if largest <= LITTLE:
            together = chunks
        in_chunks(lambda *span: compiled(span, *arguments), chunks, together)

    def compile(self) -> Callable[..., None]:
        """Read the machine code from the disk, or compile it and keep it there; return the
        function.
        """
        if self.compiled is None:
            with _compiling:
                if self.compiled is None:
                    self.compiled = self._read_or_compiled()
        return self.compiled

    def kept(self) -> bool:
        """True if there is machine code on the disk, of these sources and for this processor."""
        return any(os.access(path, os.R_OK) for path in self._files())

    def _files(self) -> list[Path]:
        """The files in which it may be kept, the best first."""
        name = f"{self.function.__module__}.{self.function.__name__}.zip"
        return [folder / name for folder in _folders(len(kernels))]

    def _read_or_compiled(self) -> Callable[..., None]:
        parameters = signature(self.function).parameters.values()
        kinds = types.void(*(_numba_type(parameter.annotation) for parameter in parameters))
        for path in self._files():
            with suppress(Exception):  # no file, a damaged one: they have no common base
                return self._through_numba(kinds, path)
        for begins in _listeners.get():
            ready = sum(kernel.compiled is not None for kernel in kernels.values())
            begins(ready + 1, len(kernels))
        try:
            return self._through_numba(kinds)
        except Exception:  # no temporary folder, a full disk
            return numba.njit(kinds, **_OPTIONS)(self.function)

    def _through_numba(self, kinds: Any, kept: Path | None = None) -> Callable[..., None]:
        """The compiled function, read from a file or kept in one."""
        with TemporaryDirectory() as scratch:
            numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = scratch, ""
            try:
                compiled = numba.njit(cache=True, **_OPTIONS)(self.function)
            finally:
                numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = _CHOSEN, _LOCATORS
            folder = compiled.stats.cache_path
            if kept:
                unpack_archive(kept, folder)  # checks it, too
            compiled.compile(kinds)
            compiled.disable_compile()
            if compiled.stats.cache_misses:
                for path in Path(folder).iterdir():
                    os.utime(path, (_TIME, _TIME))
                self._keep(Path(make_archive(f"{scratch}/kept", "zip", folder)).read_bytes())
        return compiled

    def _keep(self, data: bytes) -> None:
        """Write a file in the first folder that can be written."""
        for path in self._files():
            with suppress(OSError, OutputError):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_durably(path, data, overwrite=True)
                versions = path.parent.parent.glob("[0-9a-f]" * 16)
                for old in sorted(versions, key=lambda path: path.stat().st_mtime)[:-_VERSIONS]:
                    rmtree(old, ignore_errors=True)
                return


@cache
def _folders(_: int) -> list[Path]:
    """The folders in which kernels of this version may be, up to the first that can be written.

    None if the sources have changed since they were imported: kernels may be of the old ones, or of
    both. That is looked up for each number of kernels.
    """
    if code_digest(*_SEEN) != _SOURCE:
        return []
    places = [Path(_CHOSEN).absolute()] if _CHOSEN else []
    if "InTree" in (_LOCATORS or "InTree"):
        places.append(Path(__file__).parents[1] / "__pycache__")
    if "UserWide" in (_LOCATORS or "UserWide"):
        with suppress(RuntimeError):  # no home
            places.append(Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser())
    folders = [place / "panchroma-kernels" / _version() for place in places]
    numbers = (number for number, folder in enumerate(folders, 1) if _can_be_written(folder))
    return folders[: next(numbers, None)]


def _can_be_written(folder: Path) -> bool:
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return os.access(folder, os.W_OK | os.X_OK)


@cache
def _version() -> str:
    """Digest of all on which machine code depends."""
    facts = [_SOURCE, numba.__version__, sys.implementation.cache_tag, binding.get_process_triple()]
    facts.append(numba.config.CPU_NAME or binding.get_host_cpu_name())
    facts.append(sys.flags.optimize > 1)  # without docstrings code is another one for Numba
    if numba.config.CPU_FEATURES is None:
        facts.append(binding.get_host_cpu_features().flatten())
    others = re.compile("NUMBA_(?!CACHE|NUM_THREADS|THREADING)").match
    facts += sorted("=".join(setting) for setting in os.environ.items() if others(setting[0]))
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:16]


def _largest(argument: object) -> int:
    """Elements of the largest array among arguments, also in tuples of them."""
    if isinstance(argument, tuple):
        return max(map(_largest, argument))
    return int(getattr(argument, "size", 0))


def _numba_type(annotation: Any) -> Any:
    """Numba's type of an argument: an int, a float, one of `arrays`, or a tuple or named tuple of
    such.
    """
    if hasattr(annotation, "_fields"):
        fields = get_type_hints(annotation, include_extras=True).values()
        return types.BaseTuple.from_types(tuple(map(_numba_type, fields)), annotation)
    if hasattr(annotation, "__metadata__"):  # Annotated
        return annotation.__metadata__[0]
    if items := get_args(annotation):
        return types.BaseTuple.from_types(tuple(map(_numba_type, items)))
    return {int: types.intp, float: types.float64}[annotation]


kernels: dict[str, ParallelKernel[...]] = {}
"""All kernels that stages call, by name; the others are called by these."""


def kernel(function: F) -> F:
    """Make a function callable from kernels.

    It is not kept on the disk: who compiles a kernel compiles its callees, and so two programs
    never write the same file. Called from Python it is the Python function that it was; without
    the code by which Python would call the compiled one, kernels compile in two thirds of the time.

    In kernels and callees copy arrays element by element: for each `a[:] = b` Numba compiles a
    message about shapes that differ.
    """
    callee: F = register_jitable(no_cpython_wrapper=True, **_OPTIONS)(function)
    return callee


def parallel_kernel(
    chunks: Callable[..., int] = lambda *arguments: len(arguments[-1]),
) -> Callable[[Callable[Concatenate[Chunks, P], None]], Callable[P, None]]:
    """Compile a function when it is first called, once per machine, and let threads call it for
    different chunks.

    It is compiled for the types that its annotations name (see `arrays`).

    Parameters
    ----------
    chunks : Callable[..., int], optional
        The number of chunks, from the arguments after the first; by default the length of the last
        one, which is written. A call computes those from the first of its `Chunks` to the end.
    """

    def decorate(function: Callable[Concatenate[Chunks, P], None]) -> Callable[P, None]:
        kernels[function.__name__] = made = ParallelKernel(function, chunks)
        return made

    return decorate


def kernel_cache() -> Path:
    """The folder in which compiled kernels of this version are kept, or will be.

    Raises
    ------
    OutputError
        When there are none, and no folder can be written to.

    Examples
    --------
    >>> from panchroma.offline import kernel_cache
    >>> kernel_cache().is_absolute()
    True
    """
    for folder in _folders(len(kernels)):
        with suppress(OSError):  # one that nobody may look into
            if any(os.access(path, os.R_OK) for path in folder.glob("*.zip")):
                return folder
    return writable_cache()


def writable_cache() -> Path:
    """The folder in which a kernel that is compiled now is kept; see `kernel_cache`."""
    if folder := next(filter(_can_be_written, _folders(len(kernels))), None):
        return folder
    effect = "every run compiles for half a minute"
    remedy = "set NUMBA_CACHE_DIR to a folder that you may write to"
    raise OutputError(f"there is no folder to keep compiled kernels in: {effect}; {remedy}")


@contextmanager
def compilation(begins: Callable[[int, int], None]) -> Iterator[None]:
    """Call `begins(number, most)` before a kernel is compiled inside the `with` block, because it
    is new to this machine.

    number: this is the `number`-th kernel that is ready or in work; those that a stage calls count,
    not their callees. most: how many there are in all. Not every render needs all of them.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import PAPER, compilation, render
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.ones((24, 24), np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> with compilation(lambda number, most: print("compiling", number, "of", most)):
    ...     rendering = render(mosaic, PAPER)  # prints nothing if all kernels are in the cache
    """
    token = _listeners.set((*_listeners.get(), begins))
    try:
        yield
    finally:
        _listeners.reset(token)
