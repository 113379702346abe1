"""HTML pages in one file, which need no network, and their pieces: lists, tables, pictures. Texts are escaped here."""

import base64
import io
import os
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from shared.arrays import ByteArray
from tools.batch.console import one_line

if TYPE_CHECKING:
    from PIL.Image import Image

_TEMPLATE, _REPORT = (Path(__file__).with_name(name) for name in ("page.html", "report.css"))
_WIDEST = 1200  # pixels of a picture on a page


def bullets(sentences: Iterable[str], kind: str = "") -> str:
    """Return a list, "" if there is nothing to list; kind: a CSS class."""
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul{css_class(kind)}>{items}</ul>" if items else ""


def table(head: Iterable[str], rows: Iterable[str]) -> str:
    """Return a table that scrolls sideways if it is too wide. head: titles of the columns, empty = none; rows: made by `row`."""
    top = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    body = f"<thead><tr>{top}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f'<div class="scroll" tabindex="0" role="region" aria-label="table"><table>{body}</table></div>'


def row(cells: Iterable[str], kind: str = "") -> str:
    """Return a row of a table; cells: made by `cell` and `row_title`, kind: a CSS class."""
    return f"<tr{css_class(kind)}>{''.join(cells)}</tr>"


def row_title(text: str) -> str:
    """Return the cell that names its row."""
    return f'<th scope="row">{escape(text)}</th>'


def cell(text: str, *, best: bool = False, mark: str = "") -> str:
    """Return a cell, with `mark` before the text of the best one."""
    return f"<td{css_class('win' * best)}>{mark * best}{escape(text)}</td>"


def without_folders(line: str, names: Iterable[str]) -> str:
    """Return a line without the absolute places of files or folders that it names: a page is shared, and these are private.

    >>> without_folders("/home/me/photos/x.png: is empty", ["/home/me/photos"])
    'photos/x.png: is empty'
    """
    for place in {each for name in names for each in (str(Path(name).absolute()), os.path.realpath(name))}:
        line = line.replace(place, Path(place).name or place)
    return line


def css_class(name: str) -> str:
    """Return the attribute that gives an element a CSS class; nothing for an empty name."""
    return f' class="{name}"' if name else ""


def data_address(image: "Image", format_: str, **options: Any) -> str:
    """Return the `src` of a picture inside the page. format_: PNG or JPEG; options: as for `Image.save`."""
    file = io.BytesIO()
    image.save(file, format_, **options)
    return f"data:image/{format_.lower()};base64,{base64.b64encode(file.getvalue()).decode()}"


def figure(content: str, caption: str = "") -> str:
    """Return a figure. content: HTML; caption: text."""
    return f"<figure>{content}" + (f"<figcaption>{escape(caption)}</figcaption>" if caption else "") + "</figure>"


def picture(image: "Image", description: str) -> str:
    """Return a picture inside the page, as JPEG."""
    address = data_address(image, "JPEG", quality=88, subsampling=0)
    return f'<img src="{address}" alt="{escape(description)}" width="{image.width}" height="{image.height}">'


def reduced(pixels: ByteArray) -> "Image":
    """Return uint8 RGB (H, W, 3) as an image, reduced if it is larger than a page."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.thumbnail((_WIDEST, _WIDEST))
    return image


def page(title: str, css: str, body: str) -> bytes:
    """Return the content of a page's file.

    title: text.
    css: the style sheet.
    body: HTML.
    """
    whole = Template(_TEMPLATE.read_text("utf-8")).substitute(title=escape(title), css=css, body=body)
    # What may not be in a text, but was in a name or a value from a file, is spelled out.
    return "\n".join(map(one_line, whole.split("\n"))).encode()


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
