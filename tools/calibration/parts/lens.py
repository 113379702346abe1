"""The lens: how light falls off, from flat frames, and lateral chromatic aberration, from shots with edges."""

from functools import partial
from html import escape
from typing import Any

import numpy as np

from tools.pictures.html import figure

from ..aberration import AberrationResult
from ..part import Evidence, Part, axes, plane_colour, rounded, table
from ..shading import ShadingResult
from .gamma import black_error

_LEAST_REACH = 0.1  # pixels, of the plot's axis of displacements


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


def aberration(evidence: Evidence) -> Part | None:
    """How far the lens displaces each channel."""
    found = evidence.seen.aberration
    if found is None:
        return None
    facts: dict[str, Any] = {"shots": found.shots, "standard_error": rounded(found.error)}
    if found.aberration:
        facts |= {"corner": rounded(found.corner), "focal_length": found.aberration.focal_length}
    return Part("aberration", facts, {"aberration": found.aberration}, sections=partial(_displacements, found))


def _displacements(found: AberrationResult) -> dict[str, str]:
    """Plot how far each channel is displaced over the radius, and list it for the corners."""
    rows = [
        (letter, f"{corner:+.3f}", f"{error:.2g}" if error else "the others relate to it")
        for letter, corner, error in zip(found.channels, found.corner, found.error, strict=True)
    ]
    head = ("channel", "displacement in the corners, pixels", "standard error")
    words = f"<p>{escape(found.words[0].upper() + found.words[1:])}.</p>"
    caption = "How much further out each channel looks; points: rings of the frame by themselves, with standard errors."
    page = f'<div class="pair">{figure(_plot(found), caption)}<div>{table(head, rows)}{words}</div></div>'
    return {"Lateral chromatic aberration": page}


def _plot(found: AberrationResult) -> str:
    """Return a plot of displacement over radius with a curve per channel."""
    radius = np.linspace(0, 1, 41)
    curves = found.curve @ np.stack([radius, radius**3])
    seen = found.rings[np.isfinite(found.rings[..., 0])]
    reach = np.concatenate([np.abs(curves).ravel(), np.abs(seen[:, 1]) + seen[:, 2], [_LEAST_REACH]])
    high = 1.1 * float(reach.max())
    plot = axes((0, 1.02), (-high, high), "distance from the middle, corner = 1", "displacement, pixels")
    for channel, letter in enumerate(found.channels):
        plot.line(zip(radius.tolist(), curves[channel].tolist(), strict=True), f"plane plane-{letter}")
        style = f"fill:{plane_colour(letter)};stroke:{plane_colour(letter)}"
        for place, value, error in found.rings[:, channel][np.isfinite(found.rings[:, channel, 0])].tolist():
            low, top = max(value - error, -high), min(value + error, high)
            plot.line([(place, low), (place, top)], f"plane plane-{letter}")
            plot.dot(place, value, 3.5, f"{letter}, {place:.2f}: {value:+.2f} ± {error:.2f} pixels", style)
    return plot.drawn("Displacement over radius")
