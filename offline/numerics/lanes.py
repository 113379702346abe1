"""Explicit SIMD for kernels: a vector of neighbouring array elements that is used like one number.

A `Lanes` holds 16 float32 or 8 float64. Inside a kernel, `load(array, index)` reads the elements from `index` on along the last
axis; +, - and * work on lanes and with a scalar of their type; `store(array, index, lanes)` writes them. Loops over single elements
rely on the compiler's vectoriser, which often fails, and always on short loops: explicit vectors are ten times as fast there.

Nothing is checked: an array must have room for all lanes at every index that is used.
"""

import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

from .arrays import Scalar
from .compile import intrinsic

BYTES = 64
WIDTH = BYTES // 4
"""Number of lanes of float32; float64 has half as many."""

Values: TypeAlias = NDArray[np.float32] | NDArray[np.float64]
Index: TypeAlias = int | tuple[int, ...]


class Lanes:
    """The operations that kernels can apply to lanes, for type checkers; lanes exist inside kernels only."""

    if TYPE_CHECKING:

        def __add__(self, other: "Lanes | Scalar") -> "Lanes": ...
        def __sub__(self, other: "Lanes | Scalar") -> "Lanes": ...
        def __mul__(self, other: "Lanes | Scalar") -> "Lanes": ...
        def __radd__(self, other: Scalar) -> "Lanes": ...
        def __rsub__(self, other: Scalar) -> "Lanes": ...
        def __rmul__(self, other: Scalar) -> "Lanes": ...


class LanesType(types.Type):  # type: ignore[misc]
    """Numba's type of lanes."""

    def __init__(self, element: Any) -> None:
        self.element = element
        self.count = 8 * BYTES // element.bitwidth
        super().__init__(name=f"{element} x {self.count}")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, _vector(kind))


_SINGLE, _DOUBLE = LanesType(types.float32), LanesType(types.float64)
_KINDS = {types.float32: _SINGLE, types.float64: _DOUBLE}
# As in `kernel`: a product and a sum may become one instruction. Never an option that assumes there are no infinities: lanes beyond
# the end of a row hold arbitrary values.
_FLAGS = ("contract",)


def _vector(kind: LanesType) -> ir.VectorType:
    element = ir.FloatType() if kind.element is types.float32 else ir.DoubleType()
    return ir.VectorType(element, kind.count)


def _integers(kind: LanesType) -> ir.VectorType:
    return ir.VectorType(ir.IntType(kind.element.bitwidth), kind.count)


def _operands(builder: Any, sig: Any, args: Any) -> list[Any]:
    """All operands as lanes: scalars are repeated."""
    kind = next(each for each in sig.args if isinstance(each, LanesType))
    places = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    undefined = ir.Constant(_vector(kind), ir.Undefined)
    return [
        value
        if isinstance(each, LanesType)
        else builder.shuffle_vector(builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0)), undefined, places)
        for value, each in zip(args, sig.args, strict=True)
    ]


def _kind(*args: Any) -> LanesType | None:
    """The type of lanes of an operation on these arguments; None if they cannot be combined."""
    kinds = {each if isinstance(each, LanesType) else _KINDS.get(each) for each in args}
    lanes = any(isinstance(each, LanesType) for each in args)
    return kinds.pop() if lanes and len(kinds) == 1 else None


def _define(operation: Callable[..., Any], instruction: str) -> None:
    """Define an arithmetic operator on lanes."""

    class Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            kind = _kind(*args) if len(args) == 2 else None
            return None if kind is None else signature(kind, *args)

    infer_global(operation)(Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*_operands(builder, sig, args), flags=_FLAGS)

    for kind in (_SINGLE, _DOUBLE):
        for pair in ((kind, kind), (kind, kind.element), (kind.element, kind)):
            lower_builtin(operation, *pair)(lower)


for _name, _instruction in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul")):
    _define(getattr(operator, _name), _instruction)
    _define(getattr(operator, f"i{_name}"), _instruction)


def _pointer(context: Any, builder: Any, sig: Any, args: Any, kind: LanesType) -> Any:
    """Pointer to the lanes at args[1], an index, of args[0], an array."""
    array = make_array(sig.args[0])(context, builder, args[0])
    tuples = isinstance(sig.args[1], types.BaseTuple)
    index = cgutils.unpack_tuple(builder, args[1]) if tuples else [args[1]]
    index = [
        context.cast(builder, value, each, types.intp)
        for value, each in zip(index, sig.args[1] if tuples else [sig.args[1]], strict=True)
    ]
    pointer = cgutils.get_item_pointer(context, builder, sig.args[0], array, index, wraparound=False)
    return builder.bitcast(pointer, _vector(kind).as_pointer())


def _stored(array: Any, index: Any) -> LanesType:
    """The type of lanes in an array, which must be C-contiguous and have one index per axis. Raises TypeError otherwise."""
    axes = len(index) if isinstance(index, types.BaseTuple) else 1
    if not isinstance(array, types.Array) or array.layout != "C" or array.ndim != axes or array.dtype not in _KINDS:
        raise TypeError(f"no lanes in {array} at {index}")
    return _KINDS[array.dtype]


def _load(typing: Any, array: Any, index: Any) -> Any:
    kind = _stored(array, index)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, sig, args, kind), align=kind.element.bitwidth // 8)

    return kind(array, index), generate


def _store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    kind = _stored(array, index)
    if value is not kind:
        raise TypeError(f"{value} for an array of {kind}")

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _pointer(context, builder, sig, args, kind), align=kind.element.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, index, value), generate


def _pick(comparison: str) -> Callable[..., Any]:
    def pick(typing: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            x, y = _operands(builder, sig, args)
            return builder.select(builder.fcmp_ordered(comparison, x, y), x, y)

        return _kind(a, b)(a, b), generate  # type: ignore[misc]

    return pick


def _where_less(typing: Any, a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y, yes, no = _operands(builder, sig, args)
        return builder.select(builder.fcmp_ordered("<", x, y), yes, no)

    return _kind(a, b, then, otherwise)(a, b, then, otherwise), generate  # type: ignore[misc]


def _total(typing: Any, lanes: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        parts = [builder.extract_element(args[0], ir.Constant(ir.IntType(32), lane)) for lane in range(lanes.count)]
        while len(parts) > 1:  # halves: the same order everywhere
            half = len(parts) // 2
            parts = [builder.fadd(parts[lane], parts[lane + half]) for lane in range(half)]
        return parts[0]

    return lanes.element(lanes), generate


def _square_root(typing: Any, lanes: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = f"llvm.sqrt.v{lanes.count}f{lanes.element.bitwidth}"
        vector = _vector(lanes)
        root = cgutils.get_or_insert_function(builder.module, ir.FunctionType(vector, [vector]), name)
        return builder.call(root, args)

    return lanes(lanes), generate


def _quotient(typing: Any, a: Any, b: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.fdiv(*_operands(builder, sig, args))

    return _kind(a, b)(a, b), generate  # type: ignore[misc]


def _root_seed(typing: Any, lanes: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = _integers(_SINGLE)
        halved = builder.lshr(builder.bitcast(args[0], vector), ir.Constant(vector, [1] * WIDTH))
        return builder.bitcast(builder.sub(ir.Constant(vector, [ROOT_SEED] * WIDTH), halved), _vector(_SINGLE))

    return _SINGLE(lanes), generate


def _times_power(typing: Any, lanes: Any, exponent: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = _integers(_SINGLE)
        shifted = builder.shl(builder.bitcast(args[1], vector), ir.Constant(vector, [23] * WIDTH))
        return builder.bitcast(builder.add(builder.bitcast(args[0], vector), shifted), _vector(_SINGLE))

    return _SINGLE(lanes, exponent), generate


ROOT_SEED = 0x5F300000

load: "Callable[[Values, Index], Lanes]" = intrinsic(_load)
store: "Callable[[Values, Index, Lanes], None]" = intrinsic(_store)
lesser: "Callable[[Lanes | Scalar, Lanes | Scalar], Lanes]" = intrinsic(_pick("<"))
greater: "Callable[[Lanes | Scalar, Lanes | Scalar], Lanes]" = intrinsic(_pick(">"))
where_less: "Callable[[Lanes | Scalar, Lanes | Scalar, Lanes | Scalar, Lanes | Scalar], Lanes]" = intrinsic(_where_less)
"""(a, b, yes, no): yes where a < b, no elsewhere."""
total: "Callable[[Lanes], Any]" = intrinsic(_total)
"""The sum of the lanes, always in the same order."""
quotient: "Callable[[Lanes | Scalar, Lanes | Scalar], Lanes]" = intrinsic(_quotient)
square_root: "Callable[[Lanes], Lanes]" = intrinsic(_square_root)
root_seed: "Callable[[Lanes], Lanes]" = intrinsic(_root_seed)
"""An approximation of x^(-1/2) for float32 x > 0, by halving the exponent as an integer."""
times_power: "Callable[[Lanes, Lanes], Lanes]" = intrinsic(_times_power)
"""(x, n + 1.5 * 2**23): x * 2**n for whole n, float32, by adding to the exponent."""
