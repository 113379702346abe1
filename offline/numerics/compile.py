"""Kernels: loops compiled by Numba, once per machine, that run in threads; and their cache on the
disk.

Kernels are compiled for the types that their annotations name. Numba keeps the machine code in a
file beside the source, or in the user's cache folder, and compiles again when the file of the
kernel has changed; here also when a file of this package has, from which every kernel may take
functions or constants.

Only public interfaces of Numba are used, and nothing global is changed.
"""

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from inspect import signature
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Concatenate,
    Generic,
    ParamSpec,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import NDArray

from ...shared.processors import threads
from .arrays import Pair
from .pieces import in_pieces

F = TypeVar("F", bound=Callable[..., Any])
P = ParamSpec("P")

# Fused multiply-add, but nothing that changes the order of a sum: a kernel's result must not depend
# on where a row begins.
_OPTIONS: dict[str, Any] = {
    "fastmath": {"contract"},
    "error_model": "numpy",
    "nogil": True,
    "no_cfunc_wrapper": True,  # no C program calls them
}
_compiling = threading.Lock()
_listeners: ContextVar[tuple[Callable[[int, int], None], ...]] = ContextVar("listeners", default=())

Pieces = Pair
"""First piece and end, which every kernel takes before all other arguments: what it computes in one
call.
"""

LITTLE = 1 << 15
"""A kernel none of whose arrays has more elements runs in the thread that calls it: to wake others
costs more than it saves.
"""
# Elements of the largest array per call: some milliseconds, and tenths of a second for the slowest
# kernels.
_TOGETHER = 1 << 18


class ParallelKernel(Generic[P]):
    """A function that stages call. It is compiled, or read from the disk, when it is first called,
    for the types it names alone.

    Arguments of other types are converted if that is possible: an array that may be written can
    stand for one that may not, but float64 never for float32. Otherwise a call raises TypeError.
    """

    def __init__(
        self, function: Callable[Concatenate[Pieces, P], None], pieces: Callable[..., int]
    ) -> None:
        self._function, self._pieces = function, pieces
        self._compiled: Callable[..., None] | None = None

    @property
    def ready(self) -> bool:
        """True if it is compiled in this process."""
        return self._compiled is not None

    def __call__(self, *arguments: P.args, **_: P.kwargs) -> None:
        """Compute all pieces, in `pieces.threads()` threads."""
        compiled, pieces = self.compile(), self._pieces(*arguments)
        largest = max(array.size for array in _arrays(arguments))
        together = max(1, min(pieces * _TOGETHER // max(largest, 1), -(-pieces // (2 * threads()))))
        if largest <= LITTLE:
            together = pieces
        in_pieces(lambda *part: compiled(part, *arguments), pieces, together)

    def compile(self) -> Callable[..., None]:
        """Read the machine code from the disk, or compile it and keep it there; return the
        function.
        """
        if self._compiled is None:
            with _compiling:
                if self._compiled is None:
                    self._compiled = self._read_or_compiled()
        return self._compiled

    def kept(self) -> bool:
        """True if there is machine code on the disk that is newer than the sources, perhaps of
        another processor.
        """
        newest = max(_newest_source(), Path(self._function.__code__.co_filename).stat().st_mtime)
        return any(path.stat().st_mtime >= newest for path in self._indexes())

    def _read_or_compiled(self) -> Callable[..., None]:
        parameters = signature(self._function).parameters.values()
        kinds = types.void(*(_numba_type(parameter.annotation) for parameter in parameters))
        if not self.kept():
            for begins in _listeners.get():
                begins(sum(kernel.ready for kernel in kernels.values()) + 1, len(kernels))
            self._forget()
        try:
            return numba.njit(kinds, cache=True, **_OPTIONS)(self._function)
        except Exception:  # no folder, a full disk, a damaged file: they have no common base
            self._forget()
            return numba.njit(kinds, **_OPTIONS)(self._function)

    def _indexes(self) -> list[Path]:
        """Numba's index files of this kernel, MODULE.NAME-LINE.VERSION.nbi."""
        try:
            folder = _folder_of(self._function)
        except (OSError, RuntimeError):
            return []
        function = self._function
        module, line = function.__module__.rpartition(".")[2], function.__code__.co_firstlineno
        return [*folder.glob(f"{module}.{function.__qualname__}-{line}.*.nbi")]

    def _forget(self) -> None:
        for path in self._indexes():
            path.unlink(missing_ok=True)


def _folder_of(function: Callable[..., Any]) -> Path:
    """The folder where Numba keeps a function. Raises RuntimeError when there is none that can be
    written.
    """
    return Path(numba.njit(cache=True)(function).stats.cache_path)


@cache
def _newest_source() -> float:
    """The time, in seconds, when a file of this package was last changed."""
    return max(path.stat().st_mtime for path in Path(__file__).parent.glob("*.py"))


def _arrays(arguments: Iterable[object]) -> Iterator[NDArray[Any]]:
    """The arrays among arguments, also in tuples of them."""
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            yield argument
        elif isinstance(argument, tuple):
            yield from _arrays(argument)


def _numba_type(annotation: Any) -> Any:
    """Numba's type of an argument: an int, a float, one of `arrays`, or a tuple or named tuple of
    such.
    """
    if hasattr(annotation, "_fields"):
        fields = get_type_hints(annotation, include_extras=True).values()
        return types.BaseTuple.from_types(tuple(map(_numba_type, fields)), annotation)
    if get_origin(annotation) is Annotated:
        return annotation.__metadata__[0]
    if get_origin(annotation) is tuple:
        return types.BaseTuple.from_types(tuple(map(_numba_type, get_args(annotation))))
    return {int: types.intp, float: types.float64}[annotation]


kernels: dict[str, ParallelKernel[...]] = {}
"""All kernels that stages call, by name; the others are parts of these."""


def kernel(function: F) -> F:
    """Make a function a part of the kernels that call it.

    Parts are not kept on the disk: who compiles a kernel compiles its parts, and so two programs
    never write the same file. Called from Python a part is the Python function that it was; without
    the code by which Python would call the compiled one, kernels compile in two thirds of the time.

    In kernels and parts copy arrays element by element: for each `a[:] = b` Numba compiles a
    message about shapes that differ.
    """
    part: F = register_jitable(no_cpython_wrapper=True, **_OPTIONS)(function)
    return part


def _length_of_last(*arguments: Any) -> int:
    return len(arguments[-1])


def parallel_kernel(
    pieces: Callable[..., int] = _length_of_last,
) -> Callable[[Callable[Concatenate[Pieces, P], None]], Callable[P, None]]:
    """Compile a function when it is first called, once per machine, and let threads call it for
    different pieces.

    It is compiled for the types that its annotations name (see `arrays`).

    Parameters
    ----------
    pieces : Callable[..., int], optional
        The number of pieces, from the arguments after the first; by default the length of the last
        one, which is written. A call computes those from the first of its `Pieces` to the end.
    """

    def decorate(function: Callable[Concatenate[Pieces, P], None]) -> Callable[P, None]:
        kernels[function.__name__] = made = ParallelKernel(function, pieces)
        return made

    return decorate


def kernel_cache() -> Path:
    """The folder in which compiled kernels are kept.

    Raises
    ------
    RuntimeError
        When there is no folder that can be written.

    Examples
    --------
    >>> from panchroma.offline import kernel_cache
    >>> kernel_cache().is_absolute()
    True
    """
    return _folder_of(kernel)


@contextmanager
def compilation(begins: Callable[[int, int], None]) -> Iterator[None]:
    """Call `begins(number, most)` before a kernel is compiled inside the `with` block, because it
    is new to this machine.

    number: this is the `number`-th kernel that is ready or in work; those that a stage calls count,
    not their parts. most: how many there are in all. Not every render needs all of them.

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
