"""From a trained network to a file for onnxruntime: convolutions alone, for any number of cells.

Convolutions compute with integers of 8 bits, which takes a third of the time. Their weights keep 16
bits in the file, so that a training can begin with them: onnxruntime rounds them as it reads the
file. Where a cell is the same in another orientation, the file answers by the mean of what the
network finds in a picture and in the turned one: 0.05 to 0.08 dB. There is one set of weights for
both, for it is the turned weights that see a picture turned.

What goes in, and what becomes of the result, is computed by `offline.stages.colour_network`;
`tests/tools/training` compares both.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
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
_MIDDLE = 128  # the step of 8 bits that stands for 0 where values may be negative
_LEAST_WEIGHT = 1e-12  # of a weight: only keeps quotients finite


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

    def write(
        self,
        path: Path,
        given: Values,
        found: Values,
        facts: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Write a file that onnxruntime reads; `facts` become metadata. Raises what the check of
        ONNX raises.
        """
        first, last = (
            helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
            for name, shape in (given, found)
        )
        graph = helper.make_graph(self._nodes, path.stem, [first], [last], self._stored)
        model = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR
        )
        helper.set_model_props(model, {**facts})
        onnx.checker.check_model(model, full_check=True)
        write_durably(path, model.SerializeToString(deterministic=True), overwrite=True)


class Turn(NamedTuple):
    """Another orientation of a picture, in which its cells are the same.

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


def save_graph(
    weights: Mapping[str, FloatArray],
    units: Mapping[str, float],
    path: Path,
    facts: Mapping[str, str],
    turn: Turn | None = None,
) -> None:
    """Write a network to an ONNX file, with weights of 16 bits; `facts` and its reach become
    metadata.

    Parameters
    ----------
    weights : Mapping[str, FloatArray]
        Those of a `network.Network`, by name.
    units : Mapping[str, float]
        Of the values that are rounded to 8 bits, from `network.units`.
    turn : Turn | None, optional
        The orientation of the second look; None = there is no second look.
    """
    blocks = sum(name.startswith("wide.") for name in weights) // 2
    (_, inputs, *_), outputs = weights["enter.weight"].shape, len(weights["leave.bias"])
    spare = -inputs % _GROUP
    kept = {
        **weights,
        "enter.weight": np.pad(weights["enter.weight"], ((0, 0), (0, spare), (0, 0), (0, 0))),
    }
    graph = Graph()
    for name, values in kept.items():
        if name.endswith(".weight"):
            graph.add(
                "Cast",
                [graph.store(f"{name}_half", values.astype(np.float16))],
                name,
                to=TensorProto.FLOAT,
            )
        else:
            graph.store(name, values.astype(np.float32))
    for name, numbers in {
        "spare": [0] * 5 + [spare, 0, 0],
        "first": [1, 1],
        "last": [-1, -1],
        "axes": [2, 3],
    }.items():
        graph.store(name, np.array(numbers, np.int64))
    given = graph.add("Pad", ["features", "spare"], "padded")
    if turn is None:  # alone, the first convolution would lose up to 0.07 dB by rounding
        found = graph.add("Conv", [given, "enter.weight", "enter.bias"], "found")
        _add_blocks(graph, "", found, blocks, kept, units, "correction")
    else:
        padded = turn._replace(inputs=np.pad(turn.inputs, (0, spare)))
        _turn(graph, kept, padded)
        rounded = _rounded(graph, given, np.float32(units["features"]), np.uint8(_MIDDLE))
        entering = (
            kept["enter.weight"],
            np.einsum("oihw,ij->ojhw", kept["enter.weight"], padded.inputs),
        )
        for side, weight in zip(("", _TURNED), entering, strict=True):
            entered = _convolve(graph, f"{side}enter", rounded, weight, units["features"])
            found = _rounded(graph, entered, np.float32(units["found"]), np.uint8(_MIDDLE))
            _add_blocks(graph, side, found, blocks, kept, units, f"{side}correction_of")
        graph.add("Mean", ["correction_of", f"{_TURNED}correction_of"], "correction")
    ends: tuple[Values, Values] = (
        ("features", [1, inputs, "rows", "columns"]),
        ("correction", [1, outputs, "inner_rows", "inner_columns"]),
    )
    graph.write(path, *ends, facts)


def _add_blocks(
    graph: Graph,
    side: str,
    found: str,
    blocks: int,
    weights: Mapping[str, FloatArray],
    units: Mapping[str, float],
    out: str,
) -> None:
    """Add the residual blocks and the last convolution, whose result is `out`; `side` begins the
    names of their weights.
    """
    for block in range(blocks):
        values = found
        for kind in ("wide", "deep"):
            name = f"{kind}.{block}"
            lit = graph.add("Relu", [values], f"{side}{name}.lit")
            steps = _rounded(graph, lit, np.float32(units[name]), np.uint8(0))
            values = _convolve(
                graph, f"{side}{name}", steps, weights[f"{name}.weight"], units[name]
            )
        added = _rounded(graph, values, np.float32(units[f"added.{block}"]), np.uint8(_MIDDLE))
        inner = graph.add("Slice", [found, "first", "last", "axes"], f"{side}inner.{block}")
        found = graph.add("Add", [added, inner], f"{side}found.{block}")
    graph.add(
        "Conv",
        [graph.add("Relu", [found], f"{side}lit"), f"{side}leave.weight", f"{side}leave.bias"],
        out,
    )


def _turn(graph: Graph, weights: Mapping[str, FloatArray], turn: Turn) -> None:
    """Add the weights and biases of the network that sees the picture turned."""
    inputs, outputs = (
        graph.store(f"turned_{name}", getattr(turn, name)) for name in ("inputs", "outputs")
    )
    ends = [
        graph.store(f"turned_{name}", np.array(values))
        for name, values in (("start", [-1, -1]), ("end", [-9, -9]))
    ]
    steps = graph.store("turned_steps", np.array([-1, -1]))
    for name, values in weights.items():
        seen = name
        if values.ndim == 4 and turn.transposed:
            seen = graph.add("Transpose", [seen], f"{name}_transposed", perm=[0, 1, 3, 2])
        if values.ndim == 4 and turn.back:
            seen = graph.add("Slice", [seen, *ends, "axes", steps], f"{name}_back")
        if name == "enter.weight":
            graph.add("Einsum", [seen, inputs], _TURNED + name, equation="oihw,ij->ojhw")
        elif name.startswith("leave"):
            graph.add(
                "Einsum",
                [seen, outputs],
                _TURNED + name,
                equation="oihw,op->pihw" if values.ndim == 4 else "o,op->p",
            )
        else:
            graph.add("Identity", [seen], _TURNED + name)


def _rounded(
    graph: Graph, values: str, unit: FloatArray | np.float32, zero: IndexArray | np.uint8
) -> str:
    """Values as whole steps of 8 bits. unit, zero: the length of a step, and the step that is 0; or
    arrays of both, by channel.
    """
    steps = [
        graph.store(f"{values}_unit", np.asarray(unit)),
        graph.store(f"{values}_zero", np.asarray(zero)),
    ]
    whole = graph.add("QuantizeLinear", [values, *steps], f"{values}_steps", axis=0)
    return graph.add("DequantizeLinear", [whole, *steps], f"{values}_rounded", axis=0)


def _convolve(graph: Graph, name: str, given: str, weight: FloatArray, unit: float) -> str:
    """A convolution by weights that are rounded for each channel of the result, and a bias in whole
    steps of its sums.

    name: of the weights and the bias. given, unit: rounded values, and the length of their steps.
    """
    lengths = (np.abs(weight).max(axis=(1, 2, 3), initial=_LEAST_WEIGHT) / _LARGEST_STEP).astype(
        np.float32
    )
    sums = graph.store(f"{name}.sums", lengths * np.float32(unit))
    whole = graph.add(
        "Round", [graph.add("Div", [f"{name}.bias", sums], f"{name}.quotient")], f"{name}.whole"
    )
    steps = graph.add("Cast", [whole], f"{name}.steps", to=TensorProto.INT32)
    rounded = (
        _rounded(graph, f"{name}.weight", lengths, np.zeros(len(lengths), np.int8)),
        graph.add("DequantizeLinear", [steps, sums], f"{name}.bias_rounded", axis=0),
    )
    return graph.add("Conv", [given, *rounded], f"{name}.found")


def load_weights(path: Path) -> dict[str, FloatArray]:
    """The weights in a file of `save_graph`, by name; the first ones are padded with zeros."""
    stored = {each.name.removesuffix("_half"): each for each in onnx.load(path).graph.initializer}
    return {
        name: numpy_helper.to_array(each).astype(np.float32)
        for name, each in stored.items()
        if name.endswith((".weight", ".bias"))
    }
