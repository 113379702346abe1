"""Numba's decorators with the options that all kernels share, typed; how many threads there are; who is compiling now."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import event
from numba.core.caching import FunctionCache
from numba.extending import intrinsic as _intrinsic

F = TypeVar("F", bound=Callable[..., Any])

# Fused multiply-add, and nothing that changes the order of a sum: what a kernel computes must not depend on where a row begins.
_OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy"}
_SOURCES = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()

prange: type[range] = numba.prange


class _Cache(FunctionCache):  # type: ignore[misc]
    """Numba's cache on disk, which asks only whether a kernel's own file has changed: here, whether any of the kernels' has."""

    def _index_key(self, *args: Any) -> tuple[Any, ...]:
        return (*super()._index_key(*args), _SOURCES)


def kernel(function: F) -> F:
    """Compile a function when it is first called, once per machine."""
    return _compiled(function, parallel=False)


def parallel_kernel(function: F) -> F:
    """The same, and share its `prange` loops among the threads."""
    return _compiled(function, parallel=True)


def intrinsic(function: Callable[..., Any], *, literal: bool = False) -> Any:
    """A function of kernels that writes its own instructions; `literal`: and has to know the constants among its arguments."""
    return _intrinsic(prefer_literal=literal)(function)


def _compiled(function: F, *, parallel: bool) -> F:
    dispatcher = numba.njit(parallel=parallel, **_OPTIONS)(function)
    dispatcher._cache = _Cache(function)
    return dispatcher  # type: ignore[no-any-return]


def available_threads() -> int:
    """How many threads kernels may be given."""
    return int(numba.config.NUMBA_NUM_THREADS)


def threads() -> int:
    """How many threads kernels share now. Passed to those that divide work and memory themselves."""
    return int(numba.get_num_threads())


def use_threads(count: int) -> None:
    """How many threads the kernels called from this thread share, 1 to `available_threads()`; for programs, never for libraries."""
    numba.set_num_threads(count)


@contextmanager
def compilation(begins: Callable[[str], None]) -> Iterator[None]:
    """Tell `begins` the name of every kernel that has to be compiled meanwhile, because this machine has not run it yet."""
    with event.install_listener("numba:compile", _Listener(begins)):
        yield


class _Listener(event.Listener):  # type: ignore[misc]
    def __init__(self, begins: Callable[[str], None]) -> None:
        self._begins = begins

    def on_start(self, event: Any) -> None:
        self._begins(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass
