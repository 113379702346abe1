"""Lateral chromatic aberration, from shots with edges."""

from functools import partial
from html import escape
from typing import Any

import numpy as np

from tools.pictures.html import figure

from ..aberration import AberrationResult
from ..page import axes, plane_colour, table
from ..part import Evidence, Part, rounded

_LEAST_REACH = 0.1  # pixels, of the plot's axis of displacements


def aberration(evidence: Evidence) -> Part | None:
    """How far the lens displaces each channel."""
    found = evidence.seen.aberration
    if found is None:
        return None
    facts: dict[str, Any] = {"shots": found.shots, "standard_error": rounded(found.error)}
    if found.aberration:
        facts |= {"corner": rounded(found.corner), "focal_length": found.aberration.focal_length}
    return Part("aberration", facts, {"aberration": found.aberration}, sections=partial(_sections, found))


def _sections(found: AberrationResult) -> dict[str, str]:
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
