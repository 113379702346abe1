"""The one strict reading of numbers: of JSON documents, and of what they and their callers say of a camera.

Text and truth values are no numbers, though `float` and NumPy take both; nor is what is not finite. Python reads whole numbers of
any length, and computing with those of hundreds of digits overflows. So documents that hold one are refused as a whole.
"""

import json
import math
import operator
from numbers import Real
from typing import Any

from .errors import InputError

_MOST_DIGITS = 18  # of a whole number in a document: all of them fit into 64 bits
_SHOWN = 200  # characters of a wrong value in a message


def parsed_json(text: str | bytes) -> Any:
    """The value in a JSON document, all of whose numbers are finite. Raises InputError that does not name the file.

    >>> from shared.figures import parsed_json
    >>> parsed_json('{"gamma": [0.9, 1.1, 0.8]}')
    {'gamma': [0.9, 1.1, 0.8]}
    """
    try:
        return json.loads(text, parse_int=_whole_number, parse_float=_finite_number, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:  # ValueError: neither UTF-8 nor JSON
        raise InputError(f"is not JSON ({error})") from None


def number(name: str, value: Any) -> float:
    """A finite number as a float; InputError names the field otherwise, also for text and for truth values.

    >>> from shared.figures import number
    >>> number("focal_length", 35)
    35.0
    """
    return _checked(name, value, [value], "a number")[0]


def numbers(name: str, values: Any, count: int | None = None) -> tuple[float, ...]:
    """A list of finite numbers as floats; InputError names the field.

    count: how many there have to be; None = any number.

    >>> from shared.figures import numbers
    >>> numbers("gamma", [1, 2.5, 3], 3)
    (1.0, 2.5, 3.0)
    """
    floats = _checked(name, values, values, "a list of numbers")
    if count is not None and len(floats) != count:
        raise InputError(f"{name} has {len(floats)} figures, expected {count}")
    return floats


def tables(name: str, values: Any, depth: int) -> Any:
    """Lists of finite numbers, `depth` lists in each other, as tuples of floats; InputError names the field.

    >>> from shared.figures import tables
    >>> tables("radial", [[1, 0], [0, 0]], 2)
    ((1.0, 0.0), (0.0, 0.0))
    """
    if depth == 1:
        return numbers(name, values)
    try:
        every = tuple(values)
    except TypeError:
        raise InputError(f"{name} is not a list of lists of numbers: {shown(values)}") from None
    return tuple(tables(name, value, depth - 1) for value in every)


def whole(name: str, value: Any) -> int:
    """A whole number, also one of NumPy's, as an int; InputError names the field otherwise.

    >>> from shared.figures import whole
    >>> whole("white_level", 4095)
    4095
    """
    try:
        if not isinstance(value, bool):
            return operator.index(value)
    except TypeError:
        pass
    raise InputError(f"{name} is {shown(value)}, expected a whole number")


def shown(value: Any) -> str:
    """A value for a message, cut off where it is long.

    >>> from shared.figures import shown
    >>> shown("x" * 1000)[-20:]
    'xxxxxxxxxxxxxxxxx...'
    """
    try:
        text = repr(value)
    except ValueError:  # a whole number of more digits than Python turns into text
        text = f"a whole number of {value.bit_length()} bits"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _checked(name: str, value: Any, values: Any, expected: str) -> tuple[float, ...]:
    """Return the values as finite floats. Raises InputError, which shows `value`, for what is no number that a float can be."""
    try:
        every = tuple(values)
        if any(isinstance(item, bool) or not isinstance(item, Real) for item in every):
            raise TypeError
        floats = tuple(map(float, every))
    except (TypeError, OverflowError):
        raise InputError(f"{name} is {shown(value)}, expected {expected}") from None
    if not all(map(math.isfinite, floats)):
        raise InputError(f"{name} holds a figure that is not finite: {floats}")
    return floats


def _whole_number(text: str) -> int:
    if len(text.lstrip("-")) > _MOST_DIGITS:
        raise InputError(f"holds a number of {len(text.lstrip('-'))} digits, {text[:12]}...: no figure of a camera has so many")
    return int(text)


def _finite_number(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _no_number(text)


def _no_number(text: str) -> float:
    raise InputError(f"holds {shown(text)}, which is not a finite number")
