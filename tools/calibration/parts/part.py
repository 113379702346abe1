"""A measured part of a camera."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ....shared.arrays import DoubleArray


@dataclass(frozen=True, eq=False)
class Part:
    """One measured part of a camera: what it changes, how well it is known, and what a user has to know of it.

    name: its key in "measured" of camera.json.
    facts: for camera.json: how it was measured, and how well it is known; None = it was not, and only its warnings count.
    changes: fields of the calibration, and their values.
    warnings: sentences for the user.
    contradictions: sentences on what is wrong beyond doubt: the camera must not be used.
    refusal: why there must not be a camera file; "" = there may be one.
    result: the fit, for the report.
    """

    name: str
    facts: Mapping[str, Any] | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    contradictions: Sequence[str] = ()
    refusal: str = ""
    result: Any = None


def rounded(values: DoubleArray) -> list[float]:
    """Return numbers with three digits, for camera.json."""
    return [float(f"{value:.3g}") for value in values.tolist()]
