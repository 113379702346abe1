"""Numba's decorators with the options that all kernels share, typed; the kernels' cache on disk; the number of threads."""

import hashlib
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numba
import numpy as np
from llvmlite import binding
from numba.core import event, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic as _intrinsic

from shared.errors import PanchromaError

F = TypeVar("F", bound=Callable[..., Any])

# Fused multiply-add, but nothing that changes the order of a sum: a kernel's result must not depend on where a row begins.
_OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy"}
_IMPORT = re.compile(r"^from (\.+|shared\.)([\w.]+) import ", re.MULTILINE)
_SHARED = Path(__file__).parents[2] / "shared"
_PROCESSOR = hashlib.sha256(f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}".encode()).hexdigest()[:8]

prange: type[range] = numba.prange

LITTLE = 1 << 15
"""A kernel none of whose arrays has more elements runs in the thread that calls it. To wake others and wait for them takes up to
milliseconds where other programs are at work, as long as a burst of tiny frames takes in all."""


@cache
def sources(path: Path) -> frozenset[Path]:
    """A module's file, and those of `offline` and `shared` from which its code or numbers may come: what it imports, and so on."""
    imported = _IMPORT.findall(path.read_text(encoding="utf-8"))
    folders = ((_SHARED if where == "shared." else path.parents[len(where) - 1], name) for where, name in imported)
    files = (folder.joinpath(*name.split(".")).with_suffix(".py") for folder, name in folders)
    return frozenset({path}).union(*(sources(each) for each in files if each.exists()))


class _Cache(FunctionCache):  # type: ignore[misc]
    """Numba's cache on disk. Numba recompiles a kernel when its own file has changed; this one, when one that it imports has, too.

    A kernel that cannot be read from the disk, or not be kept there, is compiled. Files are named after the processor too: machines
    of different kinds that share a folder, and compile at the same time, would otherwise replace each other's files.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        name, stamp = f"{self._impl.filename_base}-{_PROCESSOR}", self._impl.locator.get_source_stamp()
        self._cache_file = IndexDataCacheFile(self._cache_path, name, stamp)
        texts = (path.read_bytes() for path in sorted(sources(Path(function.__code__.co_filename))))
        self._digest = hashlib.sha256(b"".join(texts)).hexdigest()

    def _index_key(self, *args: Any) -> tuple[Any, ...]:
        return (*super()._index_key(*args), self._digest)

    def load_overload(self, *args: Any) -> Any:
        try:
            return super().load_overload(*args)
        except Exception:  # what a damaged file raises when it is unpickled has no common base
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, *args: Any) -> None:
        with suppress(OSError):
            super().save_overload(*args)

    def holds(self, signature: Any, codegen: Any) -> bool:
        """Whether there is something on the disk for a signature."""
        try:
            name = self._cache_file._load_index().get(self._index_key(signature, codegen))
        except Exception:  # as in `load_overload`
            return False
        return name is not None and Path(self._cache_path, name).exists()


class ParallelKernel:
    """A function that stages call. It is compiled, or read from the disk, when it is first called, for one signature alone.

    Arguments of other types are converted if that is possible: an array that may be written can stand for one that may not, but
    float64 never for float32. Otherwise a call raises TypeError.
    """

    _threads_lost = False

    def __init__(self, function: Callable[..., Any], signature: str) -> None:
        self._signature = signature
        self._dispatcher = numba.njit(parallel=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
        with suppress(RuntimeError):  # no folder to keep it in: every program compiles it for itself
            self._dispatcher._cache = _Cache(function)
        self._lock = threading.Lock()
        self.ready = False

    def __call__(self, *arguments: Any) -> Any:
        """Call the function. Raises PanchromaError in a forked child of a process that has called one."""
        if self._threads_lost:
            raise PanchromaError(
                "this process was made by fork from one that has rendered, and the threads that render are not copied: start "
                'processes with multiprocessing.get_context("spawn") (or "forkserver"), or render nothing before they are made'
            )
        if not self.ready:
            self.compile()
        usual = threads()
        if usual == 1 or any(isinstance(each, np.ndarray) and each.size > LITTLE for each in arguments):
            return self._dispatcher(*arguments)
        use_threads(1)
        try:
            return self._dispatcher(*arguments)
        finally:
            use_threads(usual)

    def compile(self) -> None:
        """Read it from the disk, or compile it and keep it there."""
        with self._lock:
            if not self.ready:
                self._dispatcher.compile(self._types())
                self._dispatcher.disable_compile()
                self.ready = True

    def kept(self) -> bool:
        """Whether it is on the disk."""
        cache = self._dispatcher._cache
        return isinstance(cache, _Cache) and cache.holds(self._types(), self._dispatcher.targetctx.codegen())

    def _types(self) -> tuple[Any, ...]:
        names = {**vars(types), "const": lambda array: array.copy(readonly=True)}
        return tuple(map(_as_type, eval(f"{self._signature},", names)))


def _after_fork() -> None:
    """In a child: note that its parent's threads are lost. GNU's OpenMP ends such a process, or returns with nothing computed."""
    with suppress(ValueError):  # the parent had no threads yet
        ParallelKernel._threads_lost |= numba.threading_layer() == "omp" and sys.platform == "linux"


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _general(kind: Any) -> Any:
    """The type of a variable that can hold values of a type; integers are signed."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.BaseTuple):
        return types.BaseTuple.from_types(tuple(map(_general, kind)))
    return types.intp if isinstance(kind, types.Integer) else kind


def _as_type(given: Any) -> Any:
    return types.BaseTuple.from_types(tuple(map(_as_type, given))) if isinstance(given, tuple) else given


kernels: dict[str, ParallelKernel] = {}
"""All kernels that stages call, by name; the others are parts of these."""


def kernel(function: F) -> F:
    """Make a function a part of the kernels that call it; it cannot be called from Python.

    Parts are not kept on the disk: who compiles a kernel compiles its parts, and so two programs never write the same file.

    In kernels and parts copy arrays element by element: for each `a[:] = b` Numba compiles a message about shapes that differ.
    """
    part = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
    part.__class__ = _Part
    return part  # type: ignore[no-any-return]


class _Part(CPUDispatcher):  # type: ignore[misc]
    def __call__(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(f"{self.__name__} is a part of kernels, which Python cannot call")

    def get_call_template(self, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        """Numba would compile it again for each constant among its arguments, and for unsigned ones, as `prange` has."""
        return super().get_call_template(tuple(map(_general, args)), {name: _general(each) for name, each in kws.items()})


def parallel_kernel(signature: str) -> Callable[[F], F]:
    """Compile a function when it is first called, once per machine, and share its `prange` loops among the threads.

    signature: types of the arguments, in Numba's notation: f4 and f8 are floats, i8 is an integer, b1 is bool, f4[:, ::1] is an
        array, and (i8, i8) is a tuple; const(f4[:, ::1]) may be an array that must not be written.
    """

    def decorate(function: F) -> F:
        kernels[function.__name__] = made = ParallelKernel(function, signature)
        return made  # type: ignore[return-value]

    return decorate


def intrinsic(function: Callable[..., Any], *, literal: bool = False) -> Any:
    """Turn a code generator into a function that kernels can call. literal: it needs the values of constant arguments."""
    return _intrinsic(prefer_literal=literal)(function)


def available_threads() -> int:
    """The largest number of threads that `use_threads` accepts.

    >>> from offline import available_threads
    >>> available_threads() >= 1
    True
    """
    return int(numba.config.NUMBA_NUM_THREADS)


def threads() -> int:
    """The number of threads that kernels called from this thread use.

    >>> from offline import available_threads, threads
    >>> 1 <= threads() <= available_threads()
    True
    """
    return int(numba.get_num_threads())


def use_threads(count: int) -> None:
    """Set the number of threads for kernels called from this thread, 1 to `available_threads()`. The result is the same for any.

    For programs: libraries should leave this choice to them. Raises ValueError for any other number.

    >>> from offline import threads, use_threads
    >>> before = threads()
    >>> use_threads(1)
    >>> threads()
    1
    >>> use_threads(before)
    """
    numba.set_num_threads(count)


def kernel_cache() -> Path:
    """The folder in which compiled kernels are kept. Raises RuntimeError when there is no folder that can be written.

    >>> from offline import kernel_cache
    >>> kernel_cache().is_absolute()
    True
    """
    return Path(FunctionCache(kernel).cache_path)


@contextmanager
def compilation(begins: Callable[[int, int], None]) -> Iterator[None]:
    """Call `begins(number, most)` before a kernel is compiled inside the `with` block, because it is new to this machine.

    number: this is the `number`-th kernel that is ready or in work; those that a stage calls count, not their parts.
    most: how many there are in all. Not every render needs all of them.

    >>> import numpy as np
    >>> from offline import PAPER, compilation, render
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.ones((24, 24), np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> with compilation(lambda number, most: print("compiling", number, "of", most)):  # nothing if all are in the cache
    ...     rendering = render(mosaic, PAPER)
    """
    with event.install_listener("numba:compile", _Listener(begins)):
        yield


class _Listener(event.Listener):  # type: ignore[misc]
    def __init__(self, begins: Callable[[int, int], None]) -> None:
        self._begins = begins
        self._depth = 0  # Numba compiles one kernel at a time, and its parts, of which many are its own, within it

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            ready = sum(kernel.ready for kernel in kernels.values())
            self._begins(ready + 1, len(kernels))

    def on_end(self, event: Any) -> None:
        self._depth -= 1
