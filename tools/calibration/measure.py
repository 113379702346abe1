"""From observations to a camera: conclude one part after the other. Start reading here."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared import Camera
from shared.arrays import DoubleArray
from shared.errors import InputError

from .observations import Observations
from .part import Evidence, Part
from .parts.colour import colour
from .parts.dark import black_level, defects
from .parts.gamma import gamma
from .parts.lens import shading
from .parts.noise import noise

PARTS = (gamma, colour, noise, black_level, defects, shading)
"""In the order of the report. None depends on another."""
_OF_BLACK = ("gamma", "noise", "colour", "shading")  # parts that a wrong black level makes wrong
_MOVED = 2.0  # standard errors of the black level


@dataclass(frozen=True, eq=False)
class Conclusion:
    """The result of a calibration.

    evidence: what it was concluded from.
    parts: what the frames show, or say that they do not show.
    camera: the camera; None if the frames cannot determine it.
    refusal: the reason why there is no camera; "" if there is one.
    contradictions: sentences on what is wrong beyond doubt: the camera must not be used.
    warnings: sentences for the user.
    """

    evidence: Evidence
    parts: tuple[Part, ...]
    camera: Camera | None
    refusal: str
    contradictions: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """The verdict: "use it", "use it with care" or "do not use it"."""
        if self.camera is None or self.contradictions:
            return "do not use it"
        return "use it with care" if self.warnings else "use it"


def conclude(
    seen: Observations, chart_colours: DoubleArray, provenance: Mapping[str, Any] | None = None, old: Camera | None = None
) -> Conclusion:
    """Combine all that was measured into one camera.

    seen: what was measured.
    chart_colours: (24, 3), XYZ (D50) of the chart, white = 1.
    provenance: facts that every part of the camera file records.
    old: the camera file to be updated: what was measured replaces whole parts of it. None = there is none.

    Raises InputError if no frame was read.
    """
    if seen.base is None:
        raise InputError("no frame could be used")
    calibration = seen.base.calibration
    if old:
        calibration = replace(old.calibration, sensor=old.calibration.sensor or calibration.sensor)
    if seen.dark:
        calibration = replace(calibration, black_level=tuple(seen.dark.black.tolist()))
    evidence = Evidence(seen, calibration, seen.base.pattern.channels, chart_colours, old)
    parts = tuple(part for concluded in PARTS if (part := concluded(evidence)))
    measured = {part.name: {**(provenance or {}), **part.facts} for part in parts if part.facts is not None}
    changes: dict[str, Any] = {name: value for part in parts for name, value in part.changes.items()}
    if calibration.noise and "noise" not in changes and "gamma" in changes:
        # Noise is in scene units, and the new gamma rescales these.
        changes["noise"] = calibration.noise.in_units_of(calibration.full_scale / math.fsum(changes["gamma"]))
    refusal = "; ".join(part.refusal for part in parts if part.refusal)
    camera = None
    if not refusal:
        camera = Camera(replace(calibration, **changes), seen.base.pattern, {**evidence.known, **measured}, seen.base.shape)
    contradictions = tuple(line for part in parts for line in part.contradictions)
    warnings = (*seen.remarks, *(line for part in parts for line in part.warnings), *_outdated(evidence, measured))
    return Conclusion(evidence, parts, camera, refusal, contradictions, warnings)


def _outdated(evidence: Evidence, measured: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a warning of parts that are kept, and were measured with a black level that has turned out to be wrong."""
    kept = [part for part in evidence.known if part in _OF_BLACK and part not in measured]
    if not (kept and evidence.old and evidence.seen.dark):
        return ()
    moved = evidence.seen.dark.black - np.array(evidence.old.calibration.black_level)
    if not (np.abs(moved) > _MOVED * evidence.assumed.black).any():
        return ()
    return (
        f"the black level is {np.abs(moved).max():.1f} codes off the one with which {', '.join(kept)} of the camera file were "
        "measured; give all frames together to measure these again",
    )
