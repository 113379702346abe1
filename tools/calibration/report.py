"""The calibration report: one HTML page for sign-off, with the verdict first, then the measurements and how well they fit."""

import json
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path

from tools.batch.html import bullets
from tools.batch.html import report as page

from .measure import Conclusion

_STYLE = Path(__file__).with_name("report.css")
_TONES = {"use it": "good", "use it with care": "care", "do not use it": "bad"}


def report(conclusion: Conclusion, provenance: Mapping[str, str], worded: Callable[[str], str] = str) -> bytes:
    """Return the content of the page's file.

    provenance: date, program, ...
    worded: puts messages into the reader's words, see `Console.worded`.
    """
    camera, warnings = conclusion.camera, [*conclusion.contradictions, *conclusion.warnings]
    sections: dict[str, str] = {}
    for part in conclusion.parts:
        sections |= part.sections()
    sections["Skipped files"] = bullets(map(worded, conclusion.evidence.seen.skipped))
    if camera:
        text = escape(json.dumps(camera.to_json(), indent=1, ensure_ascii=False))
        sections["camera.json"] = f"<details><summary>Content, id {camera.calibration.id}</summary><pre>{text}</pre></details>"
    facts = [conclusion.refusal, *(part.headline for part in conclusion.parts)]
    if not (conclusion.refusal or warnings):
        facts.append("There are no warnings.")
    return page(
        f"Calibration of {(camera and camera.calibration.sensor) or 'the camera'}",
        ", ".join(provenance.values()),
        conclusion.verdict.capitalize(),
        _TONES[conclusion.verdict],
        sections,
        facts=[worded(" ".join(filter(None, facts)))],
        remarks=map(worded, warnings),
        css=_STYLE.read_text("utf-8"),
    )
