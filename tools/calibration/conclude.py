"""From measurements to a camera: conclude one part after the other."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...shared import Camera
from .measure import Measurements
from .parts.colour import colour
from .parts.gamma import gamma
from .parts.part import Part
from .parts.sensor import black_level, defects, noise, shading

_PARTS = (gamma, colour, noise, black_level, defects, shading)  # none depends on another
_OF_BLACK = ("gamma", "noise", "colour", "shading")  # parts that a wrong black level makes wrong
_MOVED = 2.0  # standard errors of the black level


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a calibration.

    Attributes
    ----------
    seen
        What it was concluded from.
    parts
        What the frames show, or say that they do not show: by the name in "measured" of camera.json.
    camera
        The camera; None if the frames cannot determine it.
    refusal
        The reason why there is no camera; "" if there is one.
    contradictions
        Sentences on what is wrong beyond doubt: the camera must not be used.
    warnings
        Sentences for the user.
    """

    seen: Measurements
    parts: Mapping[str, Part]
    camera: Camera | None
    refusal: str
    contradictions: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def facts(self) -> dict[str, Mapping[str, Any]]:
        """How each part that was measured is known: by the name in "measured" of camera.json."""
        return {name: part.facts for name, part in self.parts.items() if part.facts is not None}

    @property
    def verdict(self) -> str:
        """The verdict: "use it", "use it with care" or "do not use it"."""
        if self.camera is None or self.contradictions:
            return "do not use it"
        return "use it with care" if self.warnings else "use it"


def conclude(seen: Measurements, provenance: Mapping[str, Any] | None = None) -> Result:
    """Combine all that was measured into one camera.

    Parameters
    ----------
    seen
        What was measured. What it shows replaces whole parts of the old camera file.
    provenance
        Facts that every part of the camera file records.

    Raises
    ------
    InputError
        No frame was read.
    """
    calibration = seen.calibration
    parts = {part.name: part for concluded in _PARTS if (part := concluded(seen))}
    changes: dict[str, Any] = {}
    measured: dict[str, Any] = {}
    for name, part in parts.items():
        changes |= part.changes
        if part.facts is not None:
            measured[name] = {**(provenance or {}), **part.facts}
    if calibration.noise and "noise" not in changes and "gamma" in changes:
        # Noise is in scene units, and the new gamma rescales these.
        rescaled = calibration.full_scale / math.fsum(changes["gamma"])
        changes["noise"] = calibration.noise.in_units_of(rescaled)
    refusal = "; ".join(part.refusal for part in parts.values() if part.refusal)
    camera = None
    if seen.base and not refusal:
        base, parts_of = seen.base, {**seen.known, **measured}
        camera = Camera(replace(calibration, **changes), base.pattern, parts_of, base.shape)
    contradictions = tuple(line for part in parts.values() for line in part.contradictions)
    warned = [line for part in parts.values() for line in part.warnings]
    warnings = (*seen.remarks, *warned, *_outdated(seen, measured))
    return Result(seen, parts, camera, refusal, contradictions, warnings)


def _outdated(seen: Measurements, measured: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a warning of parts that are kept, and were measured with a black level that has turned out to be wrong."""
    kept = [part for part in seen.known if part in _OF_BLACK and part not in measured]
    if not (kept and seen.old and seen.dark):
        return ()
    moved = seen.dark.black - np.array(seen.old.calibration.black_level)
    if not (np.abs(moved) > _MOVED * seen.assumed().black).any():
        return ()
    return (
        f"the black level is {np.abs(moved).max():.1f} codes off the one with which {', '.join(kept)} of the camera file were "
        "measured; give all frames together to measure these again",
    )
