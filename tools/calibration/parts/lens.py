"""The lens: how light falls off, from flat frames."""

from functools import partial
from html import escape
from typing import Any

import numpy as np

from ..part import Evidence, Part, table
from ..shading import ShadingResult
from .gamma import black_error


def shading(evidence: Evidence) -> Part | None:
    """How light falls off, for each plane, and a warning if its error is that of an assumed black level."""
    found = evidence.seen.shading
    if found is None:
        return None
    gain, error, warnings = found.shading, found.error, []
    if not evidence.assumed.black_measured:  # light that is black in truth does not fall off
        error = float(np.hypot(error, found.error_of_black(black_error(evidence))))
        warnings.append(
            f"shading was measured with a black level that is assumed, and so is only known to ±{100 * error:.2g} % in the "
            "corners (standard error); take dark frames (`dark`)"
        )
    facts: dict[str, Any] = {"frames": found.frames, "standard_error": float(f"{error:.2g}")}
    if gain:
        facts |= {"stops": round(gain.stops, 3), "colour": round(gain.colour, 4)}
        facts |= {"residual": gain.residual, "focal_length": gain.focal_length}
    return Part("shading", facts, {"shading": gain}, warnings, sections=partial(_gains, found, evidence.planes))


def _gains(found: ShadingResult, planes: str) -> dict[str, str]:
    """List the gain of each plane in the corners, and how well it is known."""
    words = f"<p>{escape(found.words.capitalize())}.</p>"
    if found.shading is None:
        return {"Shading": words}
    corners = found.shading.sketch[:, [0, 0, -1, -1], [0, -1, 0, -1]]
    rows = [(letter, *(f"{gain:.3f}" for gain in gains)) for letter, gains in zip(planes, corners, strict=True)]
    return {"Shading": table(("plane", "gain top left", "top right", "bottom left", "bottom right"), rows) + words}
