"""Settings of a stage: values with ranges."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from numbers import Integral, Real
from sys import float_info
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from ..shared.errors import InputError
from ..shared.figures import shown


class Range(NamedTuple):
    """Range of a setting: a test of a value, and a description for messages."""

    holds: Callable[[Any], bool]
    expected: str


NotNegative = Annotated[float, Range(lambda value: value >= 0, "0 or more")]
Positive = Annotated[float, Range(lambda value: value > 0, "more than 0")]
Between = Annotated[float, Range(lambda value: 0 < value < 1, "between 0 and 1")]
Count = Annotated[int, Range(lambda value: value >= 1, "1 or more")]
CountOrNone = Annotated[int, Range(lambda value: value >= 0, "0 or more")]
_NUMBERS: dict[Any, tuple[type, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a finite number"),
}


def check_settings(settings: Any, name: str = "") -> None:
    """Raise InputError, which names a setting, its value and what is expected, for one that is not
    of its annotated type, or outside its range.

    Parameters
    ----------
    settings : Any
        A dataclass.
    name : str, optional
        What the names of its fields begin with.
    """
    for field in fields(settings):
        value, kind, ranges = getattr(settings, field.name), field.type, list[Range]()
        if get_origin(kind) is Annotated:
            kind, *ranges = get_args(kind)
        if not (_is_a(value, kind) and all(allowed.holds(value) for allowed in ranges)):
            _, noun = _NUMBERS.get(kind, (None, "" if ranges else getattr(kind, "__name__", "")))
            expected = ", ".join(filter(None, [noun, *(allowed.expected for allowed in ranges)]))
            raise InputError(f"settings: {name}{field.name} is {shown(value)}, expected {expected}")


def _is_a(value: Any, kind: Any) -> bool:
    """True if a value is of an annotated type: a truth value is no number, a whole number is one,
    and a tuple has items of its type, or of those of its fields.
    """
    if kind in _NUMBERS:
        known = isinstance(value, _NUMBERS[kind][0]) and isinstance(value, bool) is (kind is bool)
        return known and abs(value) <= float_info.max
    if get_origin(kind) is tuple:
        return isinstance(value, tuple) and all(_is_a(item, get_args(kind)[0]) for item in value)
    if not issubclass(kind, tuple):
        return isinstance(value, kind)
    kinds = kind.__annotations__.values()
    return isinstance(value, tuple) and len(value) == len(kinds) and all(map(_is_a, value, kinds))


class StageSettings:
    """Base of the settings of a stage: their ranges."""

    def __post_init__(self) -> None:
        """See `check_settings`."""
        check_settings(self, type(self).__name__.removesuffix("Settings").lower() + ".")


@dataclass(frozen=True)
class Switch(StageSettings):
    """A stage that is used or not.

    Attributes
    ----------
    used : bool
        Whether it is.
    """

    used: bool = False
