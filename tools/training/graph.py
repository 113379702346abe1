"""From a trained network to a file for onnxruntime: convolutions alone, for any number of cells.

What goes in, and what becomes of the result, is computed by `offline.rows.learned`; `tests/tools/training` compares both.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from offline.rows.learned import REACH
from shared.arrays import FloatArray
from shared.writing import write_durably

_OPSET, _IR = 17, 8
_GROUP = 16  # channels: onnxruntime is faster where there is a multiple of these


Values = tuple[str, list[int | str]]
"""Name of what goes in or comes out, and its shape: lengths, or names of those that may be any."""


class Graph:
    """A graph as it grows: arrays, and nodes that compute values, all known by their names."""

    def __init__(self) -> None:
        self._nodes: list[NodeProto] = []
        self._stored: list[TensorProto] = []

    def store(self, name: str, values: np.ndarray) -> str:
        """Keep an array; returns its name."""
        self._stored.append(numpy_helper.from_array(values, name))
        return name

    def add(self, kind: str, given: list[str], found: str, **attributes: Any) -> str:
        """Compute `found` from what is given, by an operator of ONNX; returns its name."""
        self._nodes.append(helper.make_node(kind, given, [found], **attributes))
        return found

    def write(self, path: Path, given: Values, found: Values, facts: Mapping[str, str] = MappingProxyType({})) -> None:
        """Write a file that onnxruntime reads; `facts` become metadata. Raises what the check of ONNX raises."""
        first, last = (helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in (given, found))
        graph = helper.make_graph(self._nodes, path.stem, [first], [last], self._stored)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR)
        helper.set_model_props(model, {**facts})
        onnx.checker.check_model(model, full_check=True)
        write_durably(path, model.SerializeToString(deterministic=True), overwrite=True)


def save_graph(weights: Mapping[str, FloatArray], path: Path, facts: Mapping[str, str]) -> None:
    """Write a network to an ONNX file, with weights of 16 bits; `facts` and its reach become metadata.

    weights: those of a `network.Network`, by name.
    """
    blocks = sum(name.startswith("wide.") for name in weights) // 2
    (_, inputs, *_), outputs = weights["enter.weight"].shape, len(weights["leave.bias"])
    spare = -inputs % _GROUP
    kept = {**weights, "enter.weight": np.pad(weights["enter.weight"], ((0, 0), (0, spare), (0, 0), (0, 0)))}
    graph = Graph()
    for name, values in kept.items():
        if name.endswith(".weight"):
            graph.add("Cast", [graph.store(f"{name}_half", values.astype(np.float16))], name, to=TensorProto.FLOAT)
        else:
            graph.store(name, values.astype(np.float32))
    for name, numbers in {"spare": [0] * 5 + [spare, 0, 0], "first": [1, 1], "last": [-1, -1], "axes": [2, 3]}.items():
        graph.store(name, np.array(numbers, np.int64))

    def convolution(name: str, given: str, found: str) -> str:
        return graph.add("Conv", [given, f"{name}.weight", f"{name}.bias"], found)

    found = convolution("enter", graph.add("Pad", ["features", "spare"], "padded"), "found0")
    for block in range(blocks):
        wide = convolution(f"wide.{block}", graph.add("Relu", [found], f"lit{block}"), f"wide{block}")
        deep = convolution(f"deep.{block}", graph.add("Relu", [wide], f"relu{block}"), f"deep{block}")
        inner = graph.add("Slice", [found, "first", "last", "axes"], f"inner{block}")
        found = graph.add("Add", [deep, inner], f"found{block + 1}")
    convolution("leave", graph.add("Relu", [found], "lit"), "correction")
    ends: tuple[Values, Values] = (
        ("features", [1, inputs, "rows", "columns"]),
        ("correction", [1, outputs, "inner_rows", "inner_columns"]),
    )
    graph.write(path, *ends, {**facts, REACH: str(blocks + 1)})


def load_weights(path: Path) -> dict[str, FloatArray]:
    """The weights in a file of `save_graph`, by name; the first ones are padded with zeros."""
    stored = {each.name.removesuffix("_half"): each for each in onnx.load(path).graph.initializer if "." in each.name}
    return {name: numpy_helper.to_array(each).astype(np.float32) for name, each in stored.items()}
