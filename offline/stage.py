"""Settings of a stage: values with ranges, and the kernels that the stage calls."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from math import inf
from typing import Annotated, Any, NamedTuple

from ..shared.errors import InputError


class Range(NamedTuple):
    """Range of a setting: a test of a value, and a description for messages."""

    holds: Callable[[Any], bool]
    expected: str


NotNegative = Annotated[float, Range(lambda value: value >= 0, "0 or more")]
Finite = Annotated[float, Range(lambda value: 0 <= value < inf, "0 or more")]
Positive = Annotated[float, Range(lambda value: value > 0, "more than 0")]
Between = Annotated[float, Range(lambda value: 0 < value < 1, "between 0 and 1")]
Count = Annotated[int, Range(lambda value: value >= 1, "1 or more")]
CountOrNone = Annotated[int, Range(lambda value: value >= 0, "0 or more")]


class StageSettings:
    """Base of the settings of a stage: their ranges, whether it is used, and which kernels it then
    calls, to compile them ahead.

    Attributes
    ----------
    asked_by : tuple[str, ...]
        Settings of which one has to be on (not False, 0 or empty), or the stage changes nothing.
    kernels : tuple[str, ...]
        Names of those that it calls when it is used; stages in rows say so themselves.
    """

    asked_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise InputError, which names a setting, its value and what is expected, for one outside
        its range.
        """
        part = type(self).__name__.removesuffix("Settings").lower()
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            for allowed in getattr(field.type, "__metadata__", ()):
                if not allowed.holds(value):
                    raise InputError(
                        f"settings: {part}.{field.name} is {value}, expected {allowed.expected}"
                    )

    @property
    def used(self) -> bool:
        """True if the stage changes anything."""
        return not self.asked_by or any(getattr(self, name) for name in self.asked_by)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels, see above."""
        return ()


@dataclass(frozen=True)
class Switch(StageSettings):
    """A stage that is used or not.

    Attributes
    ----------
    used : bool
        Whether it is.
    """

    used: bool = False
