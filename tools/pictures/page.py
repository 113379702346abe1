"""HTML pages in one file, which need no network: the skeleton of all of them, and that of a report with a verdict."""

from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from string import Template

from .html import bullets, encode_page

_TEMPLATE, _REPORT = (Path(__file__).with_name(name) for name in ("page.html", "report.css"))


def page(title: str, css: str, body: str) -> bytes:
    """Return the content of a page's file.

    title: text.
    css: the style sheet.
    body: HTML.
    """
    return encode_page(Template(_TEMPLATE.read_text("utf-8")).substitute(title=escape(title), css=css, body=body))


def report(
    title: str,
    made: str,
    verdict: str,
    tone: str,
    sections: Mapping[str, str],
    *,
    facts: Iterable[str],
    remarks: Iterable[str],
    css: str,
) -> bytes:
    """Return the content of a report's file: title, verdict and reasons on top, then the sections, each in a box.

    title, made, verdict: texts; `made` says from what the report was made.
    tone: of the verdict: "good", "care" or "bad".
    sections: heading -> HTML; those that are "" are left out.
    facts: sentences below the verdict, a paragraph each.
    remarks: what is to be listed below them.
    css: what this report needs besides the style sheet of all reports.
    """
    shown = "\n".join(f"<section><h2>{escape(name)}</h2>{body}</section>" for name, body in sections.items() if body)
    why = "".join(f"<p>{escape(fact)}</p>" for fact in facts) + bullets(remarks)
    head = (
        f'<h1>{escape(title)}</h1>\n<div class="made">{escape(made)}</div>\n'
        f'<div class="verdict {tone}"><strong>{escape(verdict)}</strong>{why}</div>'
    )
    return page(title, f"{_REPORT.read_text('utf-8')}{css}", f"<main>\n{head}\n{shown}\n</main>")
