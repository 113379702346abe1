"""The one strict reading of numbers: of JSON documents, and of what they and their callers say of a
camera.

Text and truth values are no numbers, though `float` and NumPy take both; nor is what is not finite.
Python reads whole numbers of any length, and computing with those of hundreds of digits overflows.
So documents that hold one are refused as a whole.
"""

import inspect
import json
import math
import operator
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from numbers import Real
from typing import Any, TypeVar

from .errors import InputError

Built = TypeVar("Built")

_SHOWN_LENGTH = 200  # characters of a wrong value in a message


def parsed_json(text: str | bytes) -> Any:
    """The value in a JSON document, all of whose numbers are finite.

    Raises
    ------
    InputError
        That does not name the file.

    Examples
    --------
    >>> from panchroma.shared.figures import parsed_json
    >>> parsed_json('{"gamma": [0.9, 1.1, 0.8]}')
    {'gamma': [0.9, 1.1, 0.8]}
    """
    hooks: dict[str, Any] = {"parse_float": _finite_number, "parse_constant": _finite_number}
    try:
        return json.loads(text, parse_int=_whole_number, object_pairs_hook=_fields, **hooks)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # ValueError: neither UTF-8 nor JSON
        raise InputError(f"is not JSON ({error})") from None


def numbers(name: str, values: Any, count: int | None = None, *, depth: int = 1) -> Any:
    """Return a list of finite numbers as a tuple of floats; InputError names the field, also for
    text and for truth values.

    Parameters
    ----------
    count : int | None, optional
        How many there have to be; None = any number.
    depth : int, optional
        2 for a list of such lists, 3 for a list of those.

    Examples
    --------
    >>> from panchroma.shared.figures import numbers
    >>> numbers("gamma", [1, 2.5, 3], 3), numbers("camera_to_xyz", [[1, 0], [0, 1]], depth=2)
    ((1.0, 2.5, 3.0), ((1.0, 0.0), (0.0, 1.0)))
    """
    try:
        items = tuple(values)
        if depth > 1:
            return tuple(numbers(name, item, count, depth=depth - 1) for item in items)
        if any(isinstance(item, bool) or not isinstance(item, Real) for item in items):
            raise TypeError
        floats = tuple(map(float, items))
    except (TypeError, OverflowError):
        raise InputError(f"{name} is {shown(values)}, expected a list of numbers") from None
    if not all(map(math.isfinite, floats)):
        raise InputError(f"{name} holds a figure that is not finite: {floats}")
    if count is not None and len(floats) != count:
        raise InputError(f"{name} has {len(floats)} figures, expected {count}")
    return floats


def size(name: str, value: Any) -> tuple[int, int]:
    """Return the (rows, columns) of a frame; InputError names the field.

    Examples
    --------
    >>> from panchroma.shared.figures import size
    >>> size("size", [480, 640])
    (480, 640)
    """
    sides = tuple(value) if isinstance(value, tuple | list) else ()
    if len(sides) != 2 or not all(type(side) is int and 0 < side < 1 << 20 for side in sides):
        raise InputError(f"{name} is {shown(value)}, expected [rows, columns]")
    return sides


def built(kind: Callable[..., Built], document: Any, name: str) -> Built:
    """Return the dataclass that a JSON object with its fields describes; InputError names the
    object and its fields.
    """
    try:
        return kind(**document)
    except TypeError:
        names = ", ".join(inspect.signature(kind).parameters)
        raise InputError(f"{name} is {shown(document)}, expected an object with {names}") from None


def whole(name: str, value: Any) -> int:
    """A whole number, also one of NumPy's, as an int; InputError names the field otherwise.

    Examples
    --------
    >>> from panchroma.shared.figures import whole
    >>> whole("white_level", 4095)
    4095
    """
    with suppress(TypeError):
        if not isinstance(value, bool):
            return operator.index(value)
    raise InputError(f"{name} is {shown(value)}, expected a whole number")


def shown(value: Any) -> str:
    """A value for a message, cut off where it is long.

    Examples
    --------
    >>> from panchroma.shared.figures import shown
    >>> shown("x" * 1000)[-20:]
    'xxxxxxxxxxxxxxxxx...'
    """
    try:
        text = repr(value)
    except ValueError:  # a whole number of more digits than Python turns into text
        text = f"a whole number of {value.bit_length()} bits"
    return text if len(text) <= _SHOWN_LENGTH else f"{text[:_SHOWN_LENGTH]}..."


def _fields(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        name, _ = Counter(name for name, _ in pairs).most_common(1)[0]
        raise InputError(f"holds {shown(name)} twice; delete one of them")
    return fields


def _whole_number(text: str) -> int:
    if len(text.lstrip("-")) > 18:  # all numbers of so many digits fit into 64 bits
        digits = f"holds a number of {len(text.lstrip('-'))} digits, {text[:12]}..."
        raise InputError(f"{digits}: no figure of a camera has so many")
    return int(text)


def _finite_number(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise InputError(f"holds {shown(text)}, which is not a finite number")
    return value
