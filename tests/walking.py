"""Every field of an object, changed one at a time, to see that something notices."""

from collections.abc import Iterator
from copy import copy
from dataclasses import fields, is_dataclass
from typing import Any

CHANGED = "changed"


def one_field_changed(whole: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name such as "camera.calibration.noise.shot", copy of `whole` in which that field
    alone is CHANGED).

    whole: of a dataclass. Fields that hold dataclasses are walked instead of changed. Nothing is
    checked: the copy may be invalid.
    """
    for each in fields(whole):
        value, path = getattr(whole, each.name), f"{name}.{each.name}".removeprefix(".")
        parts = one_field_changed(value, path) if is_dataclass(value) else [(path, CHANGED)]
        for place, part in parts:
            other = copy(whole)
            object.__setattr__(other, each.name, part)
            yield place, other
