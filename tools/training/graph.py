"""From the trained network to a file for onnxruntime: features, network and bounds as one ONNX graph with fixed sizes."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn
from torch.nn import functional

from .network import BASIS, BLOCKS, HALO, Network, cells_of, features, inner, pixelwise

TILE = 48
"""Cells per side of a tile. Smaller tiles compute more of their surroundings; larger ones leave the processor's cache."""
_OPSET = 18
_GATE = 1.8
"""As `NOISE` in training, and a little stricter: where noise is mistaken for colour once in a hundred cells, it can be seen."""
_MARGIN, _LEAST_MARGIN, _DIM = -0.15, 0.0, 0.2
"""How far chromaticity may go beyond that of its surroundings, in units of their range (negative: less far), and at least; and the
share of mean luminance below which a pixel's own chromaticity tells little."""


class Corrector(nn.Module):  # type: ignore[misc]
    """What a file computes: from `offline.rows.learned.Inputs`, a correction of gamma_i times channel i, (1, 3, TILE K, TILE K)."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

    def forward(self, picture: Any, error: Any, variance: Any) -> Any:
        """The three components of the correction add up to zero: luminance stays."""
        period = self.network.period
        light, colour = cells_of(picture, period)
        inputs, bound = features(light, colour, error, variance, _GATE)
        found = self.network(inputs) * inner(bound, BLOCKS + 1)
        found = within_surroundings(found, inner(light, HALO - 1), inner(colour, HALO - 1))
        return functional.conv_transpose2d(found, pixelwise(BASIS, period), stride=period)


def within_surroundings(correction: Any, light: Any, colour: Any) -> Any:
    """`correction`, (N, 2 K^2, h, w), so that no chromaticity leaves the range of those in the 3 x 3 cells around by much.

    light, colour: from `cells_of`, one cell more on each side.
    """
    pixels = light.shape[1]
    safe = torch.maximum(light, _DIM * light.mean(dim=1, keepdim=True)).clamp_min(1e-5)
    light, here = inner(light), inner(colour)
    limited = []
    for part in (slice(0, pixels), slice(pixels, 2 * pixels)):
        tint = colour[:, part] / safe
        high = functional.max_pool2d(tint.amax(dim=1, keepdim=True), 3, 1)
        low = -functional.max_pool2d((-tint).amax(dim=1, keepdim=True), 3, 1)
        margin = _MARGIN * (high - low) + _LEAST_MARGIN
        least, most = (low - margin) * inner(safe) - here[:, part], (high + margin) * inner(safe) - here[:, part]
        limited.append(torch.minimum(torch.maximum(correction[:, part], torch.clamp_max(least, 0)), torch.clamp_min(most, 0)))
    return torch.cat(limited, 1)


def save_graph(network: Network, path: Path, facts: dict[str, str]) -> None:
    """Write the network to an ONNX file, with weights of 16 bits and `facts` as metadata."""
    import warnings

    period, side = network.period, TILE + 2 * HALO
    shapes = {"picture": (1, 3, side * period, side * period), "error": (1, 4, side, side), "variance": (1, 1, side, side)}
    inputs = tuple(torch.zeros(shape) for shape in shapes.values())
    rough = path.with_suffix(".part")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            Corrector(network).eval(),
            inputs,
            input_names=list(shapes),
            output_names=["share"],
            opset_version=_OPSET,
            dynamo=True,
            verbose=False,
        )
    model = program.model_proto
    _halve(model)
    del model.metadata_props[:]
    helper.set_model_props(model, facts)
    for node in model.graph.node:
        del node.metadata_props[:]
    onnx.checker.check_model(model, full_check=True)
    rough.write_bytes(model.SerializeToString(deterministic=True))
    rough.replace(path)


def _halve(model: onnx.ModelProto) -> None:
    """Store weights with 16 bits; a node in front of each converts it when the file is loaded."""
    casts = []
    for weight in model.graph.initializer:
        values, name = numpy_helper.to_array(weight), weight.name
        if name.startswith("network.") and name.endswith(".weight"):
            weight.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
            casts.append(helper.make_node("Cast", [f"{name}_half"], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
