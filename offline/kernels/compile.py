"""Numba's decorators with the options that all kernels share, typed; the number of threads; notice of compilation."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import event
from numba.core.caching import FunctionCache
from numba.extending import intrinsic as _intrinsic

F = TypeVar("F", bound=Callable[..., Any])

# Fused multiply-add, but nothing that changes the order of a sum: a kernel's result must not depend on where a row begins.
_OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy"}
_SOURCES = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()

prange: type[range] = numba.prange
_called: list[Any] = []  # the kernels that stages call; the others are parts of these


class _Cache(FunctionCache):  # type: ignore[misc]
    """Numba's cache on disk. Numba recompiles a kernel when its own file has changed; this one, when any kernel file has.

    A kernel that cannot be read from the disk, or not be kept there, is compiled.
    """

    def _index_key(self, *args: Any) -> tuple[Any, ...]:
        return (*super()._index_key(*args), _SOURCES)

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


def kernel(function: F) -> F:
    """Compile a function when it is first called, once per machine."""
    return _compiled(function, parallel=False)


def parallel_kernel(function: F) -> F:
    """Compile a function when it is first called, once per machine, and share its `prange` loops among the threads."""
    compiled = _compiled(function, parallel=True)
    _called.append(compiled)
    return compiled


def intrinsic(function: Callable[..., Any], *, literal: bool = False) -> Any:
    """Turn a code generator into a function that kernels can call. literal: it needs the values of constant arguments."""
    return _intrinsic(prefer_literal=literal)(function)


def _compiled(function: F, *, parallel: bool) -> F:
    dispatcher = numba.njit(parallel=parallel, **_OPTIONS)(function)
    with suppress(RuntimeError):  # no folder to keep it in: every program compiles it for itself
        dispatcher._cache = _Cache(function)
    return dispatcher  # type: ignore[no-any-return]


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
    return Path(_Cache(kernel).cache_path)


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
            ready = sum(bool(kernel.signatures) for kernel in _called if kernel is not event.data["dispatcher"])
            self._begins(ready + 1, max(len(_called), ready + 1))

    def on_end(self, event: Any) -> None:
        self._depth -= 1
