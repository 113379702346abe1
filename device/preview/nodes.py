"""A small builder of preview graphs in ONNX, which names and collects nodes and constants. Needs `onnx`, like `graph`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from . import contract

Operand = str | float | Sequence[int] | NDArray[Any]
"""The name of a tensor, or a constant."""
Shape = Sequence[int | str]
"""Shape of an input or output: sizes, and names for those that vary."""

UINT8, UINT16, FLOAT = int(TensorProto.UINT8), int(TensorProto.UINT16), int(TensorProto.FLOAT)
END = 2**31 - 1
"""The end of a slice that reaches to the last element."""


class Nodes:
    """A graph under construction. Every method appends nodes and returns the name of the result."""

    def __init__(self) -> None:
        self._nodes: list[onnx.NodeProto] = []
        self._constants: dict[tuple[str, tuple[int, ...], bytes], onnx.TensorProto] = {}

    def __call__(self, operator: str, *inputs: Operand, **attributes: int | list[int]) -> str:
        """Append a node with one output."""
        return self._append(operator, inputs, 1, attributes)[0]

    def sum(self, terms: Sequence[str]) -> str:
        """The sum of the terms, added in this order."""
        total = terms[0]
        for term in terms[1:]:
            total = self("Add", total, term)
        return total

    def split(self, values: str, sizes: Sequence[int], axis: int) -> list[str]:
        """Pieces of `values`, of these sizes, along an axis."""
        return self._append("Split", [values, list(sizes)], len(sizes), {"axis": axis}) if len(sizes) > 1 else [values]

    def total(self, values: str, count: int, axis: int) -> str:
        """The sum over an axis of length `count`, added pairwise in a fixed order; that of ReduceSum is up to the runtime."""
        terms = self.split(values, [1] * count, axis)
        while len(terms) > 1:
            odd, pairs = terms[: len(terms) % 2], terms[len(terms) % 2 :]
            terms = odd + [self("Add", *pair) for pair in zip(pairs[: len(pairs) // 2], pairs[len(pairs) // 2 :], strict=True)]
        return terms[0]

    def mean(self, values: str, count: int, axis: int) -> str:
        """The mean over an axis of length `count`, see `total`."""
        return values if count == 1 else self("Mul", self.total(values, count, axis), 1 / count)

    def reshape(self, values: str, shape: Shape) -> str:
        """Reshape to sizes that are numbers or names of one-element tensors."""
        return self("Reshape", values, self("Concat", *([size] if isinstance(size, int) else size for size in shape), axis=0))

    def finish(
        self, result: str, inputs: Mapping[str, tuple[int, Shape]], kind: tuple[int, Shape], description: contract.Description
    ) -> onnx.ModelProto:
        """The finished model, checked by onnx.

        result: name of the result that is the picture.
        inputs: (type, shape) of each input, by name.
        kind: (type, shape) of the picture.
        description: kept in the metadata; its builder is the version of the producer.
        """
        self._nodes.append(helper.make_node("Identity", [result], [contract.PICTURE], contract.PICTURE))
        graph = helper.make_graph(
            self._nodes,
            "preview",
            [helper.make_tensor_value_info(each, *kind) for each, kind in inputs.items()],
            [helper.make_tensor_value_info(contract.PICTURE, *kind)],
            list(self._constants.values()),
        )
        versions = {"opset_imports": [helper.make_opsetid("", contract.OPSET)], "ir_version": contract.IR_VERSION}
        model = helper.make_model(graph, **versions, producer_name="panchroma", producer_version=description.builder)
        helper.set_model_props(model, description.to_metadata())
        onnx.checker.check_model(model, full_check=True)
        return model

    def _append(self, operator: str, inputs: Sequence[Operand], outputs: int, attributes: Mapping[str, Any]) -> list[str]:
        name = f"{operator.lower()}_{len(self._nodes)}"
        results = [name] if outputs == 1 else [f"{name}_{number}" for number in range(outputs)]
        operands = [each if isinstance(each, str) else self._constant(each) for each in inputs]
        self._nodes.append(helper.make_node(operator, operands, results, name, **attributes))
        return results

    def _constant(self, value: Operand) -> str:
        """Name of a constant tensor, stored once: float32 for floats, int64 (indices and shapes) for integers, uint8 unchanged."""
        array = np.asarray(value)
        array = array.astype({"f": np.float32, "i": np.int64, "u": np.uint8}[array.dtype.kind])
        key = array.dtype.str, array.shape, array.tobytes()
        if key not in self._constants:
            self._constants[key] = numpy_helper.from_array(array, f"constant_{len(self._constants)}")
        return self._constants[key].name
