"""Checking an untrusted preview graph before onnxruntime sees it.

onnxruntime computes the constant parts of a graph when it loads it, loops and tensors of any size among them, and opens the files
that it names as external data. So only what `graph` writes is let through, and no tensor that is larger than the frame
explains. The reader understands as much of the ONNX format
(onnx.proto) and of its encoding (Protocol Buffers) as that takes: a camera has no `onnx`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import prod

import numpy as np

from shared.errors import InputError

from . import contract
from .graph_sizes import Node, Tensor, check_sizes, tensor

OPERATORS = frozenset(
    [
        "Add",
        "Cast",
        "Clip",
        "Concat",
        "Conv",
        "Div",
        "Gather",
        "Identity",
        "Max",
        "Min",
        "Mul",
        "QuantizeLinear",
        "Relu",
        "Reshape",
        "ScatterND",
        "Shape",
        "Slice",
        "Split",
        "Sqrt",
        "Squeeze",
        "Sub",
        "Transpose",
        "Unsqueeze",
    ]
)
"""The operators of `device.preview.graph`."""

ATTRIBUTES = frozenset(["axis", "end", "perm", "start", "strides", "to"])
"""The attributes of its nodes."""

# Those that ship have less than 400 nodes and constants of 2050 numbers in all; with 240 scattered sites 1500, and 400,000 numbers.
_MOST_NODES, _MOST_NUMBERS = 1 << 12, 1 << 19
_MOST_PER_PIXEL = 8  # numbers of a tensor per pixel of a frame; ours have 1.4 at most
_PROBES = ((1, 1 << 10), (1 << 10, 1))  # patches of the frames for which sizes are found: the widest strip, and the tallest
_BYTES = {1: 4, 2: 1, 7: 8}  # of a number, by TensorProto.DataType: FLOAT, UINT8, INT64
_INT64 = 7
_MOST_AXES = 16
_MOST_WORK = 1 << 11  # steps per pixel of a frame; those that ship take 90 at most, with 240 scattered sites 1500
_MOST_CHANNELS = 32  # of an input other than the mosaic, if its size is not stated

# Field numbers in onnx.proto: of each message those that our graphs have.
_IR, _PRODUCER, _PRODUCER_VERSION, _GRAPH, _OPSET, _METADATA = 1, 2, 3, 7, 8, 14
_NODE, _GRAPH_NAME, _INITIALIZER, _INPUT, _OUTPUT, _VALUE_INFO = 1, 2, 5, 11, 12, 13
_FROM, _TO, _NODE_NAME, _OPERATOR, _ATTRIBUTE = 1, 2, 3, 4, 5
_ATTRIBUTE_NAME, _INTEGER, _INTEGERS, _ATTRIBUTE_TYPE = 1, 3, 8, 20
_DIMENSIONS, _TYPE, _NAME, _RAW = 1, 2, 8, 9
_DOMAIN, _KEY, _VALUE = 1, 1, 2
_NAME_OF_INPUT, _TYPE_OF_INPUT, _TENSOR_TYPE, _SHAPE, _SIZE = 1, 2, 1, 2, 1

_FOREIGN = "it was not written by panchroma export-preview, or it is damaged; write it again"
Field = tuple[int, int | memoryview]
"""Number and value of a field."""


def check_graph(model: bytes) -> None:
    """Raise InputError unless an ONNX model is built as our preview graphs are.

    It has their operators and small constants alone, and no tensor that is larger than its frame explains.
    """
    graph, properties = _Graph(), {}
    for number, value in _fields(model, "model", (_IR, _PRODUCER, _PRODUCER_VERSION, _GRAPH, _OPSET, _METADATA)):
        if number == _OPSET and any(field == _DOMAIN and len(_bytes(domain)) for field, domain in _fields(_bytes(value), "opset")):
            raise InputError(f"the graph has operators of a domain of its own: {_FOREIGN}")
        if number == _GRAPH:
            _read_graph(_bytes(value), graph)
        if number == _METADATA:
            texts = {field: bytes(_bytes(text)).decode("utf-8", "replace") for field, text in _fields(_bytes(value), "property")}
            properties[texts.get(_KEY, "")] = texts.get(_VALUE, "")
    _check_sizes(graph, contract.parse(properties))


@dataclass
class _Graph:
    """The parts of a graph. inputs: sizes by name, 0 = not stated."""

    nodes: list[Node] = field(default_factory=list)
    constants: dict[str, Tensor] = field(default_factory=dict)
    inputs: dict[str, list[int]] = field(default_factory=dict)


def _read_graph(message: memoryview, graph: _Graph) -> None:
    numbers = 0
    allowed = (_NODE, _GRAPH_NAME, _INITIALIZER, _INPUT, _OUTPUT, _VALUE_INFO)
    for number, value in _fields(message, "graph", allowed):
        if number == _NODE:
            graph.nodes.append(_node(_bytes(value)))
        elif number == _INITIALIZER:
            name, constant = _constant(_bytes(value))
            graph.constants[name] = constant
            numbers += constant.size
        elif number == _INPUT:
            name, sizes = _input(_bytes(value))
            graph.inputs[name] = sizes
        if len(graph.nodes) > _MOST_NODES or numbers > _MOST_NUMBERS:
            raise InputError(f"the graph has more than {_MOST_NODES} nodes, or constants of more than {_MOST_NUMBERS} numbers")


def _check_sizes(graph: _Graph, description: contract.Description) -> None:
    """Raise InputError if a tensor, or all together, are larger than our graphs make them."""
    period = description.tile.count("/") + 1
    above, below, left, right = description.halo
    for down, across in _PROBES:
        mosaic = tensor((above + down * period + below, left + across * period + right))
        inputs = {name: tensor([size or _MOST_CHANNELS for size in sizes]) for name, sizes in graph.inputs.items()}
        inputs |= {contract.MOSAIC: mosaic, **graph.constants}
        try:
            check_sizes(graph.nodes, inputs, _MOST_PER_PIXEL * mosaic.size, _MOST_WORK * mosaic.size)
        except InputError as error:
            raise InputError(f"{error}: {_FOREIGN}") from None
        except (KeyError, ValueError, IndexError, TypeError, ArithmeticError) as error:
            raise InputError(
                f"is not a graph that onnxruntime can run (its sizes contradict each other: {error}): {_FOREIGN}"
            ) from None


def _node(message: memoryview) -> Node:
    taken, given, operator, attributes = [], [], "", {}
    for number, value in _fields(message, "node", (_FROM, _TO, _NODE_NAME, _OPERATOR, _ATTRIBUTE)):
        if number == _FROM:
            taken.append(_text(value))
        elif number == _TO:
            given.append(_text(value))
        elif number == _OPERATOR:
            operator = _text(value)
        elif number == _ATTRIBUTE:
            name, numbers = _attribute(_bytes(value))
            attributes[name] = numbers
    if operator not in OPERATORS:
        raise InputError(f"the graph has the operator {operator[:40]!r}, which no preview graph has: {_FOREIGN}")
    if not ATTRIBUTES.issuperset(attributes):
        raise InputError(f"the graph's {operator} has attributes that no preview graph has: {_FOREIGN}")
    return Node(operator, taken, given, attributes)


def _attribute(message: memoryview) -> tuple[str, list[int]]:
    """Return name and numbers of an attribute, which is neither a tensor nor a graph."""
    name, numbers = "", []
    for number, value in _fields(message, "attribute", (_ATTRIBUTE_NAME, _INTEGER, _INTEGERS, _ATTRIBUTE_TYPE)):
        if number == _ATTRIBUTE_NAME:
            name = _text(value)
        elif number in (_INTEGER, _INTEGERS):
            numbers += [value] if isinstance(value, int) else _integers(value)
    return name, [value - (value >> 63 << 64) for value in numbers]


def _input(message: memoryview) -> tuple[str, list[int]]:
    """Return name and sizes of an input; 0 = not stated, or stated by a name."""
    name, sizes = "", []
    for number, value in _fields(message, "input"):
        if number == _NAME_OF_INPUT:
            name = _text(value)
        elif number == _TYPE_OF_INPUT:
            kind = _within(_bytes(value), _TENSOR_TYPE)
            for _, dimension in _fields(_within(kind, _SHAPE), "shape"):
                stated = [size for number, size in _fields(_bytes(dimension), "size") if number == _SIZE]
                sizes.append(stated[0] if stated and isinstance(stated[0], int) and stated[0] <= _MOST_CHANNELS else 0)
    return name, sizes


def _within(message: memoryview, wanted: int) -> memoryview:
    """Return the field of this number in a message; empty if there is none."""
    return next((_bytes(value) for number, value in _fields(message, "type") if number == wanted), memoryview(b""))


def _constant(message: memoryview) -> tuple[str, Tensor]:
    """Return name and values of a constant, whose bytes must be in the file, as many as its shape and type say."""
    shape: list[int] = []
    name, kind, raw = "", 0, memoryview(b"")
    for number, value in _fields(message, "constant", (_DIMENSIONS, _TYPE, _NAME, _RAW)):
        if number == _DIMENSIONS:
            shape += [value] if isinstance(value, int) else _integers(value)
        elif number == _TYPE:
            kind = value if isinstance(value, int) else 0
        elif number == _NAME:
            name = _text(value)
        elif number == _RAW:
            raw = _bytes(value)
    if kind not in _BYTES or prod(shape) * _BYTES[kind] != len(raw) or len(shape) > _MOST_AXES or max(shape, default=0) >> 31:
        raise InputError(f"a constant of the graph has {len(raw)} bytes for the shape {shape[:8]} of type {kind}: {_FOREIGN}")
    return name, np.frombuffer(raw, "<i8").reshape(shape) if kind == _INT64 else tensor(shape)


def _fields(message: bytes | memoryview, name: str, allowed: tuple[int, ...] | None = None) -> Iterator[Field]:
    """Yield the fields of a message. Raises InputError for a field that is not allowed, and for bytes that are no message."""
    data, place = memoryview(message), 0
    while place < len(data):
        key, place = _varint(data, place)
        number, kind = key >> 3, key & 7
        if kind == 0:
            value, place = _varint(data, place)
            found: int | memoryview = value
        elif kind in (1, 2, 5):
            length, place = (8, place) if kind == 1 else (4, place) if kind == 5 else _varint(data, place)
            found, place = data[place : place + length], place + length
        else:
            raise _damaged()
        if place > len(data):
            raise _damaged()
        if allowed is not None and number not in allowed:
            raise InputError(f"the graph's {name} has the field {number}, which no preview graph has: {_FOREIGN}")
        yield number, found


def _varint(data: memoryview, place: int) -> tuple[int, int]:
    """Return an integer of variable length, and the offset behind it."""
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(data):
            break
        value |= (data[place] & 0x7F) << shift
        place += 1
        if data[place - 1] < 0x80:
            return value, place
    raise _damaged()


def _integers(data: memoryview) -> list[int]:
    values, place = [], 0
    while place < len(data):
        value, place = _varint(data, place)
        values.append(value)
    return values


def _text(value: int | memoryview) -> str:
    return bytes(_bytes(value)).decode("utf-8", "replace")


def _bytes(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise _damaged()
    return value


def _damaged() -> InputError:
    return InputError(f"is not a graph that onnxruntime can run: {_FOREIGN}")
