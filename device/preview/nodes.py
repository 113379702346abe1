"""A small builder of ONNX graphs, which names and collects nodes and constants, and writes them as
a file.

A file is one message of Protocol Buffers (protobuf.dev/programming-guides/encoding), with the
fields of onnx.proto: writing the few that a preview graph needs takes less than the package `onnx`,
which no camera has.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Operand = str | float | Sequence[int] | NDArray[Any]
"""The name of a tensor, or a constant."""
Shape = Sequence[int | str]
"""Shape of an input or output: sizes, and names for those that vary."""
Variable = tuple[str, int, Shape]
"""Name, type and shape of an input or output."""

OPSET, IR_VERSION = 17, 8
"""Versions of the operators and of the file; IR 8 is as old as the opset."""
FLOAT, UINT8, UINT16, INT64 = 1, 2, 4, 7
"""Types of numbers: TensorProto.DataType in onnx.proto."""
END = 2**31 - 1
"""The end of a slice that reaches to the last element."""

_CONSTANTS = {"f": (np.float32, FLOAT), "i": (np.int64, INT64), "u": (np.uint8, UINT8)}
"""Kind of a NumPy array -> the types of numbers, in NumPy and in ONNX, with which it is stored."""
_INTEGER, _INTEGERS = 2, 7  # AttributeProto.AttributeType

_Value = int | str | bytes


class Nodes:
    """A graph under construction. Every method but `to_bytes` appends nodes and returns the name of
    the result.
    """

    def __init__(self) -> None:
        self._nodes: list[bytes] = []
        self._constants: dict[tuple[int, tuple[int, ...], bytes], str] = {}

    def __call__(self, operator: str, *inputs: Operand, **attributes: int | list[int]) -> str:
        """Append a node with one output."""
        return self._append(operator, inputs, 1, **attributes)[0]

    def sum(self, terms: Sequence[str]) -> str:
        """The sum of the terms, added in this order."""
        total = terms[0]
        for term in terms[1:]:
            total = self("Add", total, term)
        return total

    def split(self, values: str, sizes: Sequence[int], axis: int) -> list[str]:
        """Slices of `values`, of these sizes, along an axis."""
        if len(sizes) == 1:
            return [values]
        return self._append("Split", [values, list(sizes)], len(sizes), axis=axis)

    def cut(self, values: str, axis: int, *spans: tuple[int, int]) -> list[str]:
        """`values` from the first to the end of each span along an axis."""
        return [self("Slice", values, [first], [end], [axis]) for first, end in spans]

    def total(self, values: str, count: int, axis: int) -> str:
        """The sum over an axis of length `count`, added pairwise in a fixed order; that of
        ReduceSum is up to the runtime.
        """
        terms = self.split(values, [1] * count, axis)
        while len(terms) > 1:
            odd, half = len(terms) % 2, len(terms) // 2
            pairs = zip(terms[odd : odd + half], terms[odd + half :], strict=True)
            terms = terms[:odd] + [self("Add", *pair) for pair in pairs]
        return terms[0]

    def mean(self, values: str, count: int, axis: int) -> str:
        """The mean over an axis of length `count`, see `total`."""
        return values if count == 1 else self("Mul", self.total(values, count, axis), 1 / count)

    def reshape(self, values: str, shape: Shape) -> str:
        """Reshape to sizes that are numbers or names of one-element tensors."""
        sizes = ([size] if isinstance(size, int) else size for size in shape)
        return self("Reshape", values, self("Concat", *sizes, axis=0))

    def to_bytes(
        self, result: str, inputs: Sequence[Variable], output: Variable, facts: Mapping[str, str]
    ) -> bytes:
        """The finished graph as a file, always with the same bytes.

        Parameters
        ----------
        result : str
            Name of the result that is the output.
        inputs, output : Sequence[Variable], Variable
            What the graph takes, and what it returns.
        facts : Mapping[str, str]
            Texts that are kept in the file as metadata; `builder` is the version of the program
            that wrote it.
        """
        constants = [
            _message({1: shape, 2: kind, 8: name, 9: data})
            for (kind, shape, data), name in self._constants.items()
        ]
        last = _message({1: result, 2: output[0], 3: output[0], 4: "Identity"})
        nodes, given = [*self._nodes, last], _described(*output)
        taken = [_described(*each) for each in inputs]
        graph = _message({1: nodes, 2: "preview", 5: constants, 11: taken, 12: given})
        texts = [_message({1: f"panchroma.{name}", 2: fact}) for name, fact in facts.items()]
        opset, writer = _message({1: "", 2: OPSET}), {2: "panchroma", 3: facts["builder"]}
        return _message({1: IR_VERSION, **writer, 7: graph, 8: opset, 14: texts})

    def _append(
        self, operator: str, inputs: Sequence[Operand], outputs: int, **attributes: int | list[int]
    ) -> list[str]:
        name = f"{operator.lower()}_{len(self._nodes)}"
        results = [name] if outputs == 1 else [f"{name}_{number}" for number in range(outputs)]
        operands = [each if isinstance(each, str) else self._constant(each) for each in inputs]
        settings = []
        for key, value in sorted(attributes.items()):
            number, kind = (3, _INTEGER) if isinstance(value, int) else (8, _INTEGERS)
            settings.append(_message({1: key, number: value, 20: kind}))
        self._nodes.append(_message({1: operands, 2: results, 3: name, 4: operator, 5: settings}))
        return results

    def _constant(self, value: Operand) -> str:
        """Name of a constant tensor, stored once: float32 for floats, int64 (indices and shapes)
        for integers, uint8 unchanged.
        """
        array = np.asarray(value)
        dtype, kind = _CONSTANTS[array.dtype.kind]
        array = array.astype(np.dtype(dtype).newbyteorder("<"))
        content = kind, array.shape, array.tobytes()
        return self._constants.setdefault(content, f"constant_{len(self._constants)}")


def _described(name: str, kind: int, shape: Shape) -> bytes:
    """Name, type and shape of an input or output: a ValueInfoProto."""
    sizes = [_message({1: size} if isinstance(size, int) else {2: size}) for size in shape]
    return _message({1: name, 2: _message({1: _message({1: kind, 2: _message({1: sizes})})})})


def _message(fields: Mapping[int, _Value | Sequence[_Value]]) -> bytes:
    """A message of Protocol Buffers: fields by their number, rising; a list for one that is
    repeated.
    """
    encoded = []
    for number, values in fields.items():
        for value in [values] if isinstance(values, _Value) else values:
            if isinstance(value, int):
                encoded += [_varint(number << 3), _varint(value)]
            else:
                data = value.encode() if isinstance(value, str) else value
                encoded += [_varint(number << 3 | 2), _varint(len(data)), data]
    return b"".join(encoded)


def _varint(value: int) -> bytes:
    """An integer of 64 bits, seven in each byte, the lowest first; the top bit says that another
    byte follows.
    """
    value &= (1 << 64) - 1
    data = bytearray()
    while value > 0x7F:
        data.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*data, value])
