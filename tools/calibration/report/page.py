"""The report: one self-contained HTML page, with the verdict first, then the measurements and how well they fit."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template

from tools.pictures.html import bullets

from ..measure import Outcome
from .sections import aberration, camera_file, charts, colour, dark, gamma, luminance, noise, shading

_TEMPLATE = Path(__file__).with_name("page.html")
_TONES = {"use it": "good", "use it with care": "care", "do not use it": "bad"}


def report(outcome: Outcome, skipped: Sequence[str], provenance: Mapping[str, str]) -> str:
    """Return the page as HTML.

    outcome: the result of the calibration.
    skipped: a sentence per file that could not be used.
    provenance: date, program, ...
    """
    sections = {
        "Chart": charts(outcome.shots),
        "Gamma (Eq. 7)": gamma(outcome),
        "Luminance, measured and predicted": luminance(outcome),
        "Colour": colour(outcome),
        "Noise (photon transfer)": noise(outcome),
        "Dark frames": dark(outcome),
        "Shading": shading(outcome),
        "Lateral chromatic aberration": aberration(outcome),
        "Skipped files": bullets(skipped),
        "camera.json": camera_file(outcome.camera),
    }
    title = outcome.camera.calibration.sensor if outcome.camera else ""
    return Template(_TEMPLATE.read_text("utf-8")).substitute(
        title=escape(f"Calibration of {title or 'the camera'}"),
        made=escape(", ".join(provenance.values())),
        kind=_TONES[outcome.verdict],
        verdict=escape(outcome.verdict.capitalize()),
        why=_why(outcome),
        sections="\n".join(f"<section><h2>{escape(name)}</h2>{body}</section>" for name, body in sections.items() if body),
    )


def _why(outcome: Outcome) -> str:
    """Return the reasons for the verdict."""
    facts = [outcome.refusal] if outcome.refusal else []
    if not outcome.refusal and outcome.gamma is not None:
        facts.append(f"Gamma is known to ±{100 * outcome.gamma.worst:.2g} % (95 %).")
    if outcome.colour is not None:
        mean, left_out = outcome.colour.difference.mean(), outcome.colour.left_out.mean()
        facts.append(f"The colours match the reference to a mean ΔE2000 of {mean:.2f} (leave-one-out: {left_out:.2f}).")
    if not outcome.refusal and not outcome.warnings and not outcome.contradictions:
        facts.append("There are no warnings.")
    return f"<p>{escape(' '.join(facts))}</p>" + bullets((*outcome.contradictions, *outcome.warnings))
