"""Explicit SIMD for kernels: a vector of neighbouring array elements that is used like one number.

Inside a kernel `load(array, index)` reads 16 float32, or 8 float64, from `index` on along the last axis; +, - and * work on lanes
and with a scalar of their type; `store(array, index, lanes)` writes them. Loops over the elements of a line vectorise, are as fast
and plainer. Lanes are for what such loops cannot do: keep sums over many short lines in registers. Isolated blocks of holes take
2.4 times as long without them (measured).

Nothing is checked: an array must be C-contiguous and have room for all lanes at every index that is used.
"""

import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model
from numpy.typing import NDArray

from .arrays import Scalar

BYTES = 64
WIDTH = BYTES // 4
"""Number of lanes of float32; float64 has half as many."""

Values: TypeAlias = NDArray[np.float32] | NDArray[np.float64]
Index: TypeAlias = int | tuple[int, ...]
_INT32 = ir.IntType(32)
# A product and a sum may become one instruction, as in every kernel. Nothing assumes finite numbers: spare lanes hold any value.
_FLAGS = ("contract",)


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

    def __init__(self, element: Any, vector: ir.VectorType) -> None:
        self.element, self.vector = element, vector
        super().__init__(name=f"{vector.count} lanes of {element}")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, kind.vector)


_KINDS = {
    types.float32: LanesType(types.float32, ir.VectorType(ir.FloatType(), WIDTH)),
    types.float64: LanesType(types.float64, ir.VectorType(ir.DoubleType(), WIDTH // 2)),
}


def _kind(*arguments: Any) -> LanesType | None:
    """The type of an operation on lanes and scalars of one type; None if they cannot be combined, or no lanes are among them."""
    kinds = {kind if isinstance(kind, LanesType) else _KINDS.get(kind) for kind in arguments}
    return kinds.pop() if len(kinds) == 1 and any(isinstance(kind, LanesType) for kind in arguments) else None


def _typed(generate: Callable[..., Any], *arguments: Any) -> Any:
    """What `intrinsic` needs for an operation on lanes: its signature, and its code, for which scalars are repeated."""
    if (kind := _kind(*arguments)) is None:
        return None
    undefined, places = ir.Constant(kind.vector, ir.Undefined), ir.Constant(ir.VectorType(_INT32, kind.vector.count), None)

    def repeated(builder: Any, scalar: Any) -> Any:
        return builder.shuffle_vector(builder.insert_element(undefined, scalar, ir.Constant(_INT32, 0)), undefined, places)

    def code(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        operands = zip(values, signature.args, strict=True)
        return generate(builder, *(v if isinstance(a, LanesType) else repeated(builder, v) for v, a in operands))

    return kind(*arguments), code


def _unary(generate: Callable[..., Any]) -> Any:
    return intrinsic(lambda typing, a: _typed(generate, a))


def _binary(generate: Callable[..., Any]) -> Any:
    return intrinsic(lambda typing, a, b: _typed(generate, a, b))


def _operator(name: str) -> None:
    """Define +, - or * on lanes, and +=, -= or *=."""
    function = _binary(lambda builder, a, b: getattr(builder, f"f{name}")(a, b, flags=_FLAGS))
    for operation in (getattr(operator, name), getattr(operator, f"i{name}")):
        overload(operation)(lambda a, b: None if _kind(a, b) is None else lambda a, b: function(a, b))  # noqa: PLW0108 (Numba wants a function)


for _name in ("add", "sub", "mul"):
    _operator(_name)


def _stored(array: Any, index: Any) -> LanesType:
    """The type of lanes in an array, which must be C-contiguous and have one index per axis. Raises TypeError otherwise."""
    axes = len(index) if isinstance(index, types.BaseTuple) else 1
    if not isinstance(array, types.Array) or array.layout != "C" or array.ndim != axes or array.dtype not in _KINDS:
        raise TypeError(f"no lanes in {array} at {index}")
    return _KINDS[array.dtype]


def _pointer(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Pointer to the lanes at values[1], an index, of values[0], an array."""
    array, place = context.make_array(signature.args[0])(context, builder, values[0]), values[1]
    if isinstance(signature.args[1], types.BaseTuple):
        place = ir.Constant(ir.IntType(64), 0)
        for axis in range(signature.args[0].ndim):
            place = builder.mul(place, builder.extract_value(array.shape, axis))
            place = builder.add(place, builder.extract_value(values[1], axis))
    return builder.bitcast(builder.gep(array.data, [place]), _stored(*signature.args[:2]).vector.as_pointer())


def _load(typing: Any, array: Any, index: Any) -> Any:
    kind = _stored(array, index)

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.load(_pointer(context, builder, signature, values), align=kind.element.bitwidth // 8)

    return kind(array, index), code


def _store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    if value is not (kind := _stored(array, index)):
        raise TypeError(f"{value} for an array of {kind}")

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store(values[2], _pointer(context, builder, signature, values), align=kind.element.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, index, value), code


def _where_less(typing: Any, a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    return _typed(lambda builder, x, y, *choice: builder.select(builder.fcmp_ordered("<", x, y), *choice), a, b, then, otherwise)


def _total(typing: Any, lanes: Any) -> Any:
    def code(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        parts = [builder.extract_element(values[0], ir.Constant(_INT32, lane)) for lane in range(lanes.vector.count)]
        while len(parts) > 1:  # halves: the same order everywhere
            parts = [builder.fadd(*pair) for pair in zip(parts, parts[len(parts) // 2 :], strict=False)]
        return parts[0]

    return lanes.element(lanes), code


def _square_root_of(builder: Any, x: Any) -> Any:
    name = f"llvm.sqrt.v{x.type.count}f{8 * BYTES // x.type.count}"
    return builder.call(builder.module.declare_intrinsic(name, fnty=ir.FunctionType(x.type, [x.type])), [x])


def _shifted(builder: Any, shift: str, x: Any, bits: int) -> Any:
    integers = ir.VectorType(_INT32, WIDTH)
    return getattr(builder, shift)(builder.bitcast(x, integers), ir.Constant(integers, [bits] * WIDTH))


def _root_seed_of(builder: Any, x: Any) -> Any:
    seed = ir.Constant(ir.VectorType(_INT32, WIDTH), [_ROOT_SEED] * WIDTH)
    return builder.bitcast(builder.sub(seed, _shifted(builder, "lshr", x, 1)), x.type)


def _times_power_of(builder: Any, x: Any, exponent: Any) -> Any:
    shifted = _shifted(builder, "shl", exponent, 23)
    return builder.bitcast(builder.add(builder.bitcast(x, shifted.type), shifted), x.type)


_ROOT_SEED = 0x5F300000

load: "Callable[[Values, Index], Lanes]" = intrinsic(_load)
store: "Callable[[Values, Index, Lanes], None]" = intrinsic(_store)
lesser: "Callable[[Lanes | Scalar, Lanes | Scalar], Lanes]" = _binary(
    lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b)
)
greater: "Callable[[Lanes | Scalar, Lanes | Scalar], Lanes]" = _binary(
    lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b)
)
where_less: "Callable[[Lanes | Scalar, Lanes | Scalar, Lanes | Scalar, Lanes | Scalar], Lanes]" = intrinsic(_where_less)
"""(a, b, yes, no): yes where a < b, no elsewhere."""
total: "Callable[[Lanes], Any]" = intrinsic(_total)
"""The sum of the lanes, always in the same order."""
quotient: "Callable[[Lanes | Scalar, Lanes | Scalar], Lanes]" = _binary(lambda builder, a, b: builder.fdiv(a, b))
square_root: "Callable[[Lanes], Lanes]" = _unary(_square_root_of)
root_seed: "Callable[[Lanes], Lanes]" = _unary(_root_seed_of)
"""An approximation of x^(-1/2) for float32 x > 0, by halving the exponent as an integer."""
times_power: "Callable[[Lanes, Lanes], Lanes]" = _binary(_times_power_of)
"""(x, n + 1.5 * 2**23): x * 2**n for whole n, float32, by adding to the exponent."""
