"""From a trained network to a file for onnxruntime: convolutions alone, for any number of cells.

What goes in, and what becomes of the result, is computed by `offline.rows.learned`; `tests/tools/training` compares both.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from onnx import GraphProto, NodeProto, TensorProto, helper, numpy_helper

from offline.rows.learned import REACH
from shared.arrays import FloatArray

_OPSET, _IR = 17, 8
_GROUP = 16  # channels: onnxruntime is faster where there is a multiple of these


def save_graph(weights: Mapping[str, FloatArray], path: Path, facts: Mapping[str, str]) -> None:
    """Write a network to an ONNX file, with weights of 16 bits; `facts` and its reach become metadata.

    weights: those of a `network.Network`, by name.
    """
    blocks = sum(name.startswith("wide.") for name in weights) // 2
    (_, inputs, *_), outputs = weights["enter.weight"].shape, len(weights["leave.bias"])
    spare = -inputs % _GROUP
    kept = {**weights, "enter.weight": np.pad(weights["enter.weight"], ((0, 0), (0, spare), (0, 0), (0, 0)))}
    stored, nodes = [], []
    for name, values in kept.items():
        half = name.endswith(".weight")
        stored.append(numpy_helper.from_array(values.astype(np.float16 if half else np.float32), name + "_half" * half))
        if half:
            nodes.append(helper.make_node("Cast", [f"{name}_half"], [name], to=TensorProto.FLOAT))
    for name, numbers in {"spare": [0] * 5 + [spare, 0, 0], "first": [1, 1], "last": [-1, -1], "axes": [2, 3]}.items():
        stored.append(numpy_helper.from_array(np.array(numbers, np.int64), name))
    nodes += [_node("Pad", ["features", "spare"], "padded"), _convolution("enter", "padded", "found0")]
    for block in range(blocks):
        before = f"found{block}"
        nodes += [
            _node("Relu", [before], f"lit{block}"),
            _convolution(f"wide.{block}", f"lit{block}", f"wide{block}"),
            _node("Relu", [f"wide{block}"], f"relu{block}"),
            _convolution(f"deep.{block}", f"relu{block}", f"deep{block}"),
            _node("Slice", [before, "first", "last", "axes"], f"inner{block}"),
            _node("Add", [f"deep{block}", f"inner{block}"], f"found{block + 1}"),
        ]
    nodes += [_node("Relu", [f"found{blocks}"], "lit"), _convolution("leave", "lit", "correction")]
    given = helper.make_tensor_value_info("features", TensorProto.FLOAT, [1, inputs, "rows", "columns"])
    found = helper.make_tensor_value_info("correction", TensorProto.FLOAT, [1, outputs, "inner_rows", "inner_columns"])
    write_graph(helper.make_graph(nodes, path.stem, [given], [found], stored), path, {**facts, REACH: str(blocks + 1)})


def write_graph(graph: GraphProto, path: Path, facts: Mapping[str, str]) -> None:
    """Write a graph to an ONNX file that onnxruntime reads; `facts` become metadata. Raises what the check of ONNX raises."""
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR)
    helper.set_model_props(model, {**facts})
    onnx.checker.check_model(model, full_check=True)
    rough = path.with_suffix(".part")
    rough.write_bytes(model.SerializeToString(deterministic=True))
    rough.replace(path)


def load_weights(path: Path) -> dict[str, FloatArray]:
    """The weights in a file of `save_graph`, by name; the first ones are padded with zeros."""
    stored = {each.name.removesuffix("_half"): each for each in onnx.load(path).graph.initializer if "." in each.name}
    return {name: numpy_helper.to_array(each).astype(np.float32) for name, each in stored.items()}


def _convolution(name: str, given: str, found: str) -> NodeProto:
    return _node("Conv", [given, f"{name}.weight", f"{name}.bias"], found)


def _node(kind: str, given: list[str], found: str) -> NodeProto:
    return helper.make_node(kind, given, [found])
