"""Preview graphs are checked before onnxruntime runs any part of them."""

import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from device import Preview
from device.preview.graph import build_preview
from device.preview.graph_check import OPERATORS, check_graph
from shared import CfaPattern
from shared.errors import InputError

OWN = build_preview(CfaPattern.bayer(6), 3)


CHECKERBOARD = CfaPattern(tuple("".join("RGBC"[row * column % 7 % 4] + "W" for column in range(8)) for row in range(16)))


@pytest.mark.parametrize("pattern", [CfaPattern.bayer(3), CfaPattern.bayer(6), CfaPattern.bayer(16), CHECKERBOARD])
def test_our_graphs_pass(pattern: CfaPattern) -> None:
    check_graph(build_preview(pattern, pattern.period).SerializeToString())
    check_graph(build_preview(pattern, 1, linear=True).SerializeToString())


def changed(what: str) -> bytes:
    model = type(OWN)()
    model.CopyFrom(OWN)

    def add(name: str, kind: int, shape: list[int], values: list[int] | None = None) -> None:
        array = np.resize(values or [0], shape).astype(np.int64 if kind == TensorProto.INT64 else np.float32)
        model.graph.initializer.append(numpy_helper.from_array(array, name))

    match what:
        case "operator":
            model.graph.node[0].op_type = "ConstantOfShape"
        case "tensor":
            model.graph.node[0].attribute.append(
                helper.make_attribute("value", helper.make_tensor("a", TensorProto.FLOAT, [1], [1]))
            )
        case "external":
            model.graph.initializer[0].external_data.add(key="location", value="/dev/zero")
        case "shape":
            model.graph.initializer[0].dims.append(7)
        case "domain":
            model.opset_import.append(helper.make_opsetid("com.microsoft", 1))
        case "function":
            model.functions.add(name="f")
        case "doubling":
            add("d0", TensorProto.FLOAT, [4])
            model.graph.node.extend(helper.make_node("Concat", [f"d{n}"] * 2, [f"d{n + 1}"], axis=0) for n in range(20))
        case "product":
            add("row", TensorProto.FLOAT, [1, 5000])
            model.graph.node.append(helper.make_node("Transpose", ["row"], ["column"], perm=[1, 0]))
            model.graph.node.append(helper.make_node("Mul", ["row", "column"], ["square"]))
        case "gather":
            add("many", TensorProto.INT64, [5000])
            add("one", TensorProto.FLOAT, [1, 1])
            model.graph.node.append(helper.make_node("Gather", ["one", "many"], ["column"], axis=0))
            model.graph.node.append(helper.make_node("Gather", ["column", "many"], ["square"], axis=1))
        case "channels":
            add("kernel", TensorProto.FLOAT, [9000, 1, 1, 1])
            add("axes", TensorProto.INT64, [2], [0, 1])
            model.graph.node.append(helper.make_node("Cast", ["mosaic"], ["light"], to=1))
            model.graph.node.append(helper.make_node("Unsqueeze", ["light", "axes"], ["image"]))
            model.graph.node.append(helper.make_node("Conv", ["image", "kernel"], ["planes"]))
        case "padding":
            model.graph.node[0].attribute.append(helper.make_attribute("pads", [10000] * 4))
        case "work":
            model.graph.node.append(helper.make_node("Cast", ["mosaic"], ["w0"], to=1))
            model.graph.node.extend(helper.make_node("Sqrt", [f"w{n}"], [f"w{n + 1}"]) for n in range(2400))
        case "nodes":
            model.graph.node.extend([model.graph.node[0]] * 5000)
        case "numbers":
            model.graph.initializer.append(helper.make_tensor("b", TensorProto.FLOAT, [600000], bytes(2400000), raw=True))
    return bytes(model.SerializeToString())


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("operator", "operator 'ConstantOfShape'"),
        ("tensor", "attribute has the field 5"),
        ("external", "constant has the field 13"),
        ("shape", "a constant of the graph has"),
        ("domain", "a domain of its own"),
        ("function", "model has the field 25"),
        ("doubling", "Concat makes a tensor of"),
        ("product", "Mul makes a tensor of 25000000 numbers"),
        ("gather", "Gather makes a tensor of 25000000 numbers"),
        ("channels", "Conv makes a tensor of"),
        ("padding", "attributes that no preview graph has"),
        ("work", "Sqrt makes a tensor of"),
        ("nodes", "more than 4096 nodes"),
        ("numbers", "more than 524288 numbers"),
    ],
)
def test_anything_else_is_refused(what: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Preview(changed(what))


def test_every_operator_is_used() -> None:
    graphs = [build_preview(CfaPattern.bayer(6), scale, linear=linear) for scale in (1, 3) for linear in (False, True)]
    graphs.append(build_preview(CfaPattern.bayer(3), 1))
    assert {node.op_type for graph in graphs for node in graph.graph.node} == OPERATORS
