"""The sizes of all tensors of an untrusted graph, found without computing them.

A tensor is an array without memory, one number that all elements share. Only small whole numbers, which give sizes, have values.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.errors import InputError

Tensor = NDArray[Any]

_MOST_VALUES = 1 << 10  # numbers of a tensor whose values are computed
_ELEMENTWISE = {
    "Add": np.add,
    "Sub": np.subtract,
    "Mul": np.multiply,
    "Div": np.floor_divide,
    "Max": np.maximum,
    "Identity": np.positive,
}


@dataclass(frozen=True)
class Node:
    """A node of a graph: its operator, names of its inputs and outputs, and its attributes, integers or lists of integers."""

    operator: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    attributes: Mapping[str, Sequence[int]]


def tensor(shape: Sequence[int]) -> Tensor:
    """A tensor of this shape whose values are unknown."""
    return np.broadcast_to(np.float32(0), tuple(shape))


def check_sizes(nodes: Sequence[Node], tensors: Mapping[str, Tensor], most: int, most_work: int) -> None:
    """Raise InputError unless each tensor that the nodes make has at most `most` numbers, and all take at most `most_work` steps.

    nodes: in an order in which each input exists before it is used.
    tensors: inputs and constants by name; those of integers have values, others need not.
    most_work: a step makes one number; a convolution takes one for each of its weights.
    """
    known, work = dict(tensors), 0
    for node in nodes:
        inputs = [known[name] for name in node.inputs if name]
        results = _results(node, inputs)
        weights = prod(inputs[1].shape[1:]) if node.operator == "Conv" else 1
        for name, result in zip(node.outputs, results, strict=True):
            work += result.size * weights
            if result.size > most or work > most_work:
                raise InputError(f"{node.operator} makes a tensor of {result.size} numbers, too many for the size of the frame")
            known[name] = result


def _results(node: Node, inputs: list[Tensor]) -> list[Tensor]:
    first, *others = inputs
    axis = node.attributes.get("axis", [0])[0]
    match node.operator:
        case "Concat":
            return [_concatenated(inputs, axis)]
        case "Conv":
            steps = node.attributes.get("strides", [1] * (first.ndim - 2))
            sides = [(a - b) // step + 1 for a, b, step in zip(first.shape[2:], others[0].shape[2:], steps, strict=True)]
            return [tensor((first.shape[0], others[0].shape[0], *sides))]
        case "Gather":
            return [tensor((*first.shape[:axis], *others[0].shape, *first.shape[axis:][1:]))]
        case "Reshape":
            sizes = [first.shape[place] if size == 0 else size for place, size in enumerate(_values(others[0]))]
            if -1 in sizes:
                sizes[sizes.index(-1)] = first.size // max(1, -prod(sizes))
            return [_reshaped(first, sizes)]
        case "Shape":
            sizes = list(first.shape)[node.attributes.get("start", [0])[0] : node.attributes.get("end", [first.ndim])[0]]
            return [np.array(sizes, np.int64)]
        case "Slice":
            starts, ends, *rest = map(_values, others)
            index = [slice(None)] * first.ndim
            for begin, end, place in zip(starts, ends, rest[0] if rest else range(len(starts)), strict=True):
                index[place] = slice(begin, end)
            return [first[tuple(index)]]
        case "Split":
            return np.split(first, np.cumsum(_values(others[0]))[:-1].tolist(), axis)
        case "Squeeze":
            return [np.squeeze(first, tuple(_values(others[0])))]
        case "Unsqueeze":
            return [np.expand_dims(first, tuple(_values(others[0])))]
        case "Transpose":
            return [np.transpose(first, node.attributes.get("perm"))]
        case "ScatterND":
            return [tensor(first.shape)]
    return [_elementwise(_ELEMENTWISE.get(node.operator), inputs)]


def _elementwise(function: Callable[..., Tensor] | None, inputs: list[Tensor]) -> Tensor:
    shape = np.broadcast_shapes(*(each.shape for each in inputs))
    if function is not None and prod(shape) <= _MOST_VALUES and all(each.dtype == np.int64 for each in inputs):
        return function(*inputs)
    return tensor(shape)


def _concatenated(inputs: list[Tensor], axis: int) -> Tensor:
    length = sum(each.shape[axis] for each in inputs)
    if length <= _MOST_VALUES and all(each.dtype == np.int64 and each.ndim == 1 for each in inputs):
        return np.concatenate(inputs)
    shape = list(inputs[0].shape)
    shape[axis] = length
    return tensor(shape)


def _reshaped(values: Tensor, sizes: list[int]) -> Tensor:
    return values.reshape(sizes) if values.dtype == np.int64 and values.size <= _MOST_VALUES else tensor(sizes)


def _values(given: Tensor) -> list[int]:
    if given.dtype != np.int64 or given.ndim != 1:
        raise ValueError("sizes that are no whole numbers")
    values: list[int] = given.tolist()
    return values
