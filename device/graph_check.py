"""Checking an untrusted preview graph before onnxruntime sees it.

onnxruntime computes the constant parts of a graph when it loads it, loops and tensors of any size among them, and opens the files
that it names as external data. So only what `device.graph` writes is let through. The reader understands as much of the ONNX format
(onnx.proto) and of its encoding (Protocol Buffers) as that takes: a camera has no `onnx`.
"""

from collections.abc import Iterator
from math import prod

from shared.errors import InputError

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
"""The operators of `device.graph`."""

_MOST_NODES, _MOST_NUMBERS = 1 << 12, 1 << 15  # our graphs have less than 350 nodes, and constants of 2050 numbers in all
_LARGEST_GROWTH = 1 << 12  # how many times a tensor may be joined to itself
_BYTES = {1: 4, 2: 1, 7: 8}  # of a number, by TensorProto.DataType: FLOAT, UINT8, INT64

# Field numbers in onnx.proto: of each message those that our graphs have.
_IR, _PRODUCER, _PRODUCER_VERSION, _GRAPH, _OPSET, _METADATA = 1, 2, 3, 7, 8, 14
_NODE, _GRAPH_NAME, _INITIALIZER, _INPUT, _OUTPUT, _VALUE_INFO = 1, 2, 5, 11, 12, 13
_FROM, _TO, _NODE_NAME, _OPERATOR, _ATTRIBUTE = 1, 2, 3, 4, 5
_ATTRIBUTE_NAME, _INTEGER, _INTEGERS, _ATTRIBUTE_TYPE = 1, 3, 8, 20
_DIMENSIONS, _TYPE, _NAME, _RAW = 1, 2, 8, 9
_DOMAIN = 1

_FOREIGN = "it was not written by panchroma export-preview, or it is damaged; write it again"
Field = tuple[int, int | memoryview]
"""Number and value of a field."""


def check_graph(model: bytes) -> None:
    """Raise InputError unless an ONNX model is built as our preview graphs are: from their operators and small constants alone."""
    for number, value in _fields(model, "model", (_IR, _PRODUCER, _PRODUCER_VERSION, _GRAPH, _OPSET, _METADATA)):
        if number == _OPSET and any(field == _DOMAIN and len(_bytes(domain)) for field, domain in _fields(_bytes(value), "opset")):
            raise InputError(f"the graph has operators of a domain of its own: {_FOREIGN}")
        if number == _GRAPH:
            _check_nodes(_bytes(value))


def _check_nodes(graph: memoryview) -> None:
    growth: dict[bytes, int] = {}  # name of a tensor -> upper bound of how many copies of one tensor are joined in it
    nodes = numbers = 0
    allowed = (_NODE, _GRAPH_NAME, _INITIALIZER, _INPUT, _OUTPUT, _VALUE_INFO)
    for number, value in _fields(graph, "graph", allowed):
        if number == _NODE:
            nodes += 1
            _check_node(_bytes(value), growth)
        elif number == _INITIALIZER:
            numbers += _constant_size(_bytes(value))
        if nodes > _MOST_NODES or numbers > _MOST_NUMBERS:
            raise InputError(f"the graph has more than {_MOST_NODES} nodes, or constants of more than {_MOST_NUMBERS} numbers")


def _check_node(node: memoryview, growth: dict[bytes, int]) -> None:
    taken, given, operator = [], [], ""
    for number, value in _fields(node, "node", (_FROM, _TO, _NODE_NAME, _OPERATOR, _ATTRIBUTE)):
        if number == _FROM:
            taken.append(bytes(_bytes(value)))
        elif number == _TO:
            given.append(bytes(_bytes(value)))
        elif number == _OPERATOR:
            operator = bytes(_bytes(value)).decode("ascii", "replace")
        elif number == _ATTRIBUTE:  # numbers, neither tensors nor graphs
            for _ in _fields(_bytes(value), "attribute", (_ATTRIBUTE_NAME, _INTEGER, _INTEGERS, _ATTRIBUTE_TYPE)):
                pass
    if operator not in OPERATORS:
        raise InputError(f"the graph has the operator {operator[:40]!r}, which no preview graph has: {_FOREIGN}")
    sizes = [growth.get(name, 1) for name in taken] or [1]
    size = sum(sizes) if operator == "Concat" else max(sizes)
    if size > _LARGEST_GROWTH:
        raise InputError(f"the graph joins a tensor with itself more than {_LARGEST_GROWTH} times: {_FOREIGN}")
    growth.update(dict.fromkeys(given, size))


def _constant_size(tensor: memoryview) -> int:
    """Count of numbers in a constant, whose bytes must be in the file, as many as its shape and type say."""
    shape: list[int] = []
    kind = held = 0
    for number, value in _fields(tensor, "constant", (_DIMENSIONS, _TYPE, _NAME, _RAW)):
        if number == _DIMENSIONS:
            shape += [value] if isinstance(value, int) else _integers(value)
        elif number == _TYPE:
            kind = value if isinstance(value, int) else 0
        elif number == _RAW:
            held = len(_bytes(value))
    if kind not in _BYTES or prod(shape) * _BYTES[kind] != held or min(shape, default=0) < 0:
        raise InputError(f"a constant of the graph has {held} bytes for the shape {shape[:8]} of type {kind}: {_FOREIGN}")
    return prod(shape)


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


def _bytes(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise _damaged()
    return value


def _damaged() -> InputError:
    return InputError(f"is not a graph that onnxruntime can run: {_FOREIGN}")
