"""From a trained network to a file for onnxruntime: convolutions alone, for any number of
superpixels.

Convolutions compute with integers of 8 bits, which takes a third of the time. Their weights keep 16
bits in the file, so that a training can begin with them: onnxruntime rounds them as it reads the
file. Where a superpixel is the same in another orientation, the file looks twice: it answers by the
mean of what the network finds in a picture and in the turned one. There is one set of weights for
both, for it is the turned weights that see a picture turned.

What goes in, and what becomes of the result, is computed by `offline.stages.colour_network`;
`tests/tools/training` compares both.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from ...shared.arrays import FloatArray, IndexArray
from ...shared.writing import write_durably

_OPSET, _IR = 17, 8
_GROUP = 16  # channels: onnxruntime is faster where there is a multiple of these
# steps of a rounded weight: with more, the sum of two products may not fit in the 16 bits that AVX2
# has for it
_LARGEST_STEP = 63
_TURNED = "turned."  # begins the names of the weights that see the picture turned
_MIDDLE = np.uint8(128)  # the step of 8 bits that stands for 0 where values may be negative
_LEAST_WEIGHT = 1e-12  # of a weight: only keeps quotients finite

Weights = Mapping[str, FloatArray]
"""Those of a `network.Network`, by name."""
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

    def store_weights(self, weights: "Weights") -> None:
        """Keep weights with 16 bits, and biases."""
        for name, values in weights.items():
            if name.endswith(".weight"):
                half = self.store(f"{name}_half", values.astype(np.float16))
                self.add("Cast", [half], name, to=TensorProto.FLOAT)
            else:
                self.store(name, values.astype(np.float32))

    def add(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        """Compute an output from inputs, by an operator of ONNX; returns its name."""
        self._nodes.append(helper.make_node(kind, inputs, [output], output, **attributes))
        return output

    def write(self, path: Path, source: Values, result: Values) -> None:
        """Write a file that onnxruntime reads. Raises what the check of ONNX raises."""
        described, single = helper.make_tensor_value_info, TensorProto.FLOAT
        first, last = ([described(name, single, shape)] for name, shape in (source, result))
        graph = helper.make_graph(self._nodes, path.stem, first, last, self._stored)
        opsets = [helper.make_opsetid("", _OPSET)]
        model = helper.make_model(graph, opset_imports=opsets, ir_version=_IR)
        onnx.checker.check_model(model, full_check=True)
        write_durably(path, model.SerializeToString(deterministic=True), overwrite=True)


class Turn(NamedTuple):
    """Another orientation of a picture, in which its superpixels are the same.

    Attributes
    ----------
    inputs, outputs : FloatArray
        (I, I) and (O, O), what a network's inputs and its outputs become there.
    transposed : bool
        Whether rows become columns.
    back : bool
        Whether both are in reverse order then.
    """

    inputs: FloatArray
    outputs: FloatArray
    transposed: bool
    back: bool


def save_graph(weights: Weights, units: Mapping[str, float], path: Path, turn: Turn) -> None:
    """Write a network to an ONNX file, with weights of 16 bits.

    Parameters
    ----------
    weights : Weights
        Those of the network.
    units : Mapping[str, float]
        Of the values that are rounded to 8 bits, from `network.units`.
    turn : Turn
        The orientation of the second look; there is none if it is the same.
    """
    (_, inputs, *_), outputs = weights["enter.weight"].shape, len(weights["leave.bias"])
    spare = -inputs % _GROUP
    enter = np.pad(weights["enter.weight"], ((0, 0), (0, spare), (0, 0), (0, 0)))
    kept, graph = {**weights, "enter.weight": enter}, Graph()
    graph.store_weights(kept)
    constants = {"first": [1, 1], "last": [-1, -1], "axes": [2, 3]}
    for name, numbers in {"spare": [0] * 5 + [spare, 0, 0], **constants}.items():
        graph.store(name, np.array(numbers, np.int64))
    padded = graph.add("Pad", ["features", "spare"], "padded")
    if not (turn.transposed or turn.back):  # alone, the first convolution would lose by rounding
        output = graph.add("Conv", [padded, "enter.weight", "enter.bias"], "found")
        graph.add("Identity", [_add_blocks(graph, "", output, kept, units)], "correction")
    else:
        turn = turn._replace(inputs=np.pad(turn.inputs, (0, spare)))
        turned = np.einsum("oihw,ij->ojhw", enter, turn.inputs)
        _turn(graph, kept, turn)
        seen, answers = rounded(graph, padded, np.float32(units["features"]), _MIDDLE), []
        for side, weight in (("", enter), (_TURNED, turned)):
            entered = convolved(graph, f"{side}enter", seen, weight, units["features"])
            output = rounded(graph, entered, np.float32(units["found"]), _MIDDLE)
            answers.append(_add_blocks(graph, side, output, kept, units))
        graph.add("Mean", answers, "correction")
    features: Values = "features", [1, inputs, "rows", "columns"]
    graph.write(path, features, ("correction", [1, outputs, "inner_rows", "inner_columns"]))


def _add_blocks(
    graph: Graph, side: str, entered: str, weights: Weights, units: Mapping[str, float]
) -> str:
    """Add the residual blocks and the last convolution; `side` begins the names of their
    weights.
    """
    blocks = sum(name.startswith("wide.") for name in weights) // 2
    for block in range(blocks):
        values = entered
        for name in (f"wide.{block}", f"deep.{block}"):
            lit = graph.add("Relu", [values], f"{side}{name}.lit")
            steps = rounded(graph, lit, np.float32(units[name]), np.uint8(0))
            weight = f"{name}.weight"
            values = convolved(graph, f"{side}{name}", steps, weights[weight], units[name])
        added = rounded(graph, values, np.float32(units[f"added.{block}"]), _MIDDLE)
        inner = graph.add("Slice", [entered, "first", "last", "axes"], f"{side}inner.{block}")
        entered = graph.add("Add", [added, inner], f"{side}found.{block}")
    lit = graph.add("Relu", [entered], f"{side}lit")
    leave = f"{side}leave"
    return graph.add("Conv", [lit, f"{leave}.weight", f"{leave}.bias"], f"{leave}.found")


def _turn(graph: Graph, weights: Weights, turn: Turn) -> None:
    """Add the weights and biases of the network that sees the picture turned."""
    inputs = graph.store("turned_inputs", turn.inputs)
    outputs = graph.store("turned_outputs", turn.outputs)
    start = graph.store("turned_start", np.array([-1, -1]))
    end = graph.store("turned_end", np.array([-9, -9]))
    steps = graph.store("turned_steps", np.array([-1, -1]))
    for name, values in weights.items():
        weight, is_kernel = name, values.ndim == 4
        if is_kernel and turn.transposed:
            weight = graph.add("Transpose", [weight], f"{name}_transposed", perm=[0, 1, 3, 2])
        if is_kernel and turn.back:
            weight = graph.add("Slice", [weight, start, end, "axes", steps], f"{name}_back")
        if name == "enter.weight":
            graph.add("Einsum", [weight, inputs], _TURNED + name, equation="oihw,ij->ojhw")
        elif name.startswith("leave"):
            equation = "oihw,op->pihw" if is_kernel else "o,op->p"
            graph.add("Einsum", [weight, outputs], _TURNED + name, equation=equation)
        else:
            graph.add("Identity", [weight], _TURNED + name)


def rounded(
    graph: Graph, values: str, unit: FloatArray | np.float32, zero: IndexArray | np.uint8
) -> str:
    """Values as whole steps of 8 bits. unit, zero: the length of a step, and the step that is 0; or
    arrays of both, by channel.
    """
    length = graph.store(f"{values}_unit", np.asarray(unit))
    steps = [length, graph.store(f"{values}_zero", np.asarray(zero))]
    whole = graph.add("QuantizeLinear", [values, *steps], f"{values}_steps", axis=0)
    return graph.add("DequantizeLinear", [whole, *steps], f"{values}_rounded", axis=0)


def convolved(
    graph: Graph, name: str, values: str, weight: FloatArray, unit: float, **attributes: Any
) -> str:
    """A convolution by weights that are rounded for each channel of the result, and a bias in whole
    steps of its sums.

    name: of the weights and the bias. values, unit: rounded ones, and the length of their steps.
    attributes: of the operator.
    """
    largest = np.abs(weight).max(axis=(1, 2, 3), initial=_LEAST_WEIGHT)
    lengths = (largest / _LARGEST_STEP).astype(np.float32)
    sums = graph.store(f"{name}.sums", lengths * np.float32(unit))
    quotient = graph.add("Div", [f"{name}.bias", sums], f"{name}.quotient")
    whole = graph.add("Round", [quotient], f"{name}.whole")
    steps = graph.add("Cast", [whole], f"{name}.steps", to=TensorProto.INT32)
    steps_of = rounded(graph, f"{name}.weight", lengths, np.zeros(len(lengths), np.int8))
    bias = graph.add("DequantizeLinear", [steps, sums], f"{name}.bias_rounded", axis=0)
    return graph.add("Conv", [values, steps_of, bias], f"{name}.found", **attributes)


def load_weights(path: Path) -> dict[str, FloatArray]:
    """The weights in a file of `save_graph`, by name; the first ones are padded with zeros."""
    stored = {item.name.removesuffix("_half"): item for item in onnx.load(path).graph.initializer}
    return {
        name: numpy_helper.to_array(item).astype(np.float32)
        for name, item in stored.items()
        if name.endswith((".weight", ".bias"))
    }
