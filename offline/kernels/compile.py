"""Numba's decorators with the options that all kernels share, typed, and the kernels' cache on disk."""

import hashlib
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from inspect import signature
from pathlib import Path
from typing import Annotated, Any, Concatenate, Generic, NoReturn, ParamSpec, TypeVar, get_args, get_origin

import numba
import numpy as np
from llvmlite import binding
from numba.core import types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys
from numba.extending import intrinsic as _intrinsic
from numpy.typing import NDArray

from shared.processors import threads

from .arrays import Pair
from .pieces import in_pieces

F = TypeVar("F", bound=Callable[..., Any])

# Fused multiply-add, but nothing that changes the order of a sum: a kernel's result must not depend on where a row begins.
_OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy"}
_IMPORT = re.compile(r"^from (\.+|shared\.)([\w.]+) import ", re.MULTILINE)
_SHARED = Path(__file__).parents[2] / "shared"
_compiling = threading.Lock()
_listeners: ContextVar[tuple[Callable[[int, int], None], ...]] = ContextVar("listeners", default=())
_PROCESSOR = hashlib.sha256(f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}".encode()).hexdigest()[:8]

P = ParamSpec("P")
Pieces = Pair
"""First piece and end, which every kernel takes before all other arguments: what it computes in one call."""

LITTLE = 1 << 15
"""A kernel none of whose arrays has more elements runs in the thread that calls it: to wake others costs more than it saves."""
_TOGETHER = 1 << 18  # elements of the largest array per call: some milliseconds, and tenths of a second for the slowest kernels


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

    def load_overload(self, signature: Any, target: Any) -> Any:
        found = None
        try:
            # Numba's own begins with all types and functions that it knows, which take as long as all else in loading kernels.
            rtsys.initialize(target)
            found = self._load_overload(signature, target)
        except Exception:  # what a damaged file raises when it is unpickled has no common base
            with suppress(OSError):
                self.flush()
        if found is None:
            _announce()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        # Numba also keeps what is needed to compile a function that calls this one, which takes half of the time to load a kernel,
        # and names modules of its own for constants that their functions may need: none of them does.
        (name, kind, (code, _)), *rest, environments = self._impl.reduce(compiled)
        symbols = compiled.fndesc.llvm_func_name, compiled.fndesc.llvm_cpython_wrapper_name
        empty = binding.parse_assembly("".join(f'define void @"{each}"() {{ ret void }}\n' for each in symbols))
        kept = (name, kind, (code, empty.as_bitcode())), *rest, tuple(each for each in environments if each.consts)
        with suppress(OSError):
            self._impl.locator.ensure_cache_path()
            self._cache_file.save(self._index_key(signature, compiled.codegen), kept)

    def holds(self, signature: Any, codegen: Any) -> bool:
        """Whether there is something on the disk for a signature."""
        try:
            name = self._cache_file._load_index().get(self._index_key(signature, codegen))
        except Exception:  # as in `load_overload`
            return False
        return name is not None and Path(self._cache_path, name).exists()


def _announce() -> None:
    """Tell who listens that a kernel is about to be compiled."""
    for begins in _listeners.get():
        begins(sum(kernel.ready for kernel in kernels.values()) + 1, len(kernels))


class ParallelKernel(Generic[P]):
    """A function that stages call. It is compiled, or read from the disk, when it is first called, for the types it names alone.

    Arguments of other types are converted if that is possible: an array that may be written can stand for one that may not, but
    float64 never for float32. Otherwise a call raises TypeError.
    """

    def __init__(self, function: Callable[Concatenate[Pieces, P], None], pieces: Callable[..., int]) -> None:
        self._types = tuple(_numba_type(each.annotation) for each in signature(function).parameters.values())
        self._pieces = pieces
        self._dispatcher = numba.njit(nogil=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
        with suppress(RuntimeError):  # no folder to keep it in: every program compiles it for itself
            self._dispatcher._cache = _Cache(function)
        self.ready = False

    def __call__(self, *arguments: P.args, **_: P.kwargs) -> None:
        """Compute all pieces, in `pieces.threads()` threads."""
        if not self.ready:
            self.compile()
        pieces = self._pieces(*arguments)
        largest = max(each.size for each in _arrays(arguments))
        together = max(1, min(pieces * _TOGETHER // max(largest, 1), -(-pieces // (2 * threads()))))
        compiled = self._dispatcher
        in_pieces(lambda *part: compiled(part, *arguments), pieces, pieces if largest <= LITTLE else together)

    def compile(self) -> None:
        """Read it from the disk, or compile it and keep it there."""
        with _compiling:
            if not self.ready:
                if not isinstance(self._dispatcher._cache, _Cache):
                    _announce()
                self._dispatcher.compile(self._types)
                self._dispatcher.disable_compile()
                self.ready = True

    def kept(self) -> bool:
        """Whether it is on the disk."""
        cache = self._dispatcher._cache
        return isinstance(cache, _Cache) and cache.holds(self._types, self._dispatcher.targetctx.codegen())


def _arrays(arguments: Iterable[object]) -> Iterator[NDArray[Any]]:
    """The arrays among arguments, also in tuples of them."""
    for each in arguments:
        if isinstance(each, np.ndarray):
            yield each
        elif isinstance(each, tuple):
            yield from _arrays(each)


def _general(kind: Any) -> Any:
    """The type of a variable that can hold values of a type; integers are signed."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.BaseTuple):
        return types.BaseTuple.from_types(tuple(map(_general, kind)))
    return types.intp if isinstance(kind, types.Integer) else kind


def _numba_type(annotation: Any) -> Any:
    """Numba's type of an argument: an int, a float, one of `arrays`, or a tuple of such."""
    if get_origin(annotation) is Annotated:
        return annotation.__metadata__[0]
    if get_origin(annotation) is tuple:
        return types.BaseTuple.from_types(tuple(map(_numba_type, get_args(annotation))))
    return {int: types.intp, float: types.float64}[annotation]


kernels: dict[str, ParallelKernel[...]] = {}
"""All kernels that stages call, by name; the others are parts of these."""


def kernel(function: F) -> F:
    """Make a function a part of the kernels that call it; it cannot be called from Python.

    Parts are not kept on the disk: who compiles a kernel compiles its parts, and so two programs never write the same file.

    In kernels and parts copy arrays element by element: for each `a[:] = b` Numba compiles a message about shapes that differ.
    """
    part = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=_PartCompiler, **_OPTIONS)(function)
    part.__class__ = _Part
    return part


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """What kernels link. It is neither optimised nor made machine code by itself: the kernel that links it is, as a whole.

    Both methods belong to Numba's inside. A Numba that calls them otherwise does what it does for any function.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _PartCompiler(Compiler):  # type: ignore[misc]
    def define_pipelines(self) -> Any:
        if hasattr(self.state.flags, "no_compile"):
            self.state.flags.no_compile = True
            self.state.library = _PartLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class _Part(CPUDispatcher):  # type: ignore[misc]
    def __call__(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(f"{self.__name__} is a part of kernels, which Python cannot call")

    def get_call_template(self, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        """Numba would compile it again for each constant among its arguments, and for unsigned ones."""
        return super().get_call_template(tuple(map(_general, args)), {name: _general(each) for name, each in kws.items()})

    def add_overload(self, compiled: Any) -> None:
        """Numba finds functions by their entry points, and a part has none: anything unique stands for it."""
        if compiled.entry_point is None:
            compiled = compiled._replace(entry_point=object())
            self.targetctx.insert_user_function(compiled.entry_point, compiled.fndesc, [compiled.library])
            self.overloads[tuple(compiled.signature.args)] = compiled
        else:
            super().add_overload(compiled)


def _length_of_last(*arguments: Any) -> int:
    return len(arguments[-1])


def parallel_kernel(
    pieces: Callable[..., int] = _length_of_last,
) -> Callable[[Callable[Concatenate[Pieces, P], None]], Callable[P, None]]:
    """Compile a function when it is first called, once per machine, and let threads call it for different pieces.

    It is compiled for the types that its annotations name (see `arrays`).

    pieces: the number of pieces, from the arguments after the first; by default the length of the last one, which is written. A
        call computes those from the first of its `Pieces` to the end.
    """

    def decorate(function: Callable[Concatenate[Pieces, P], None]) -> Callable[P, None]:
        kernels[function.__name__] = made = ParallelKernel(function, pieces)
        return made

    return decorate


def intrinsic(function: Callable[..., Any]) -> Any:
    """Turn a code generator into a function that kernels can call."""
    return _intrinsic(prefer_literal=False)(function)


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
    token = _listeners.set((*_listeners.get(), begins))
    try:
        yield
    finally:
        _listeners.reset(token)
