"""Pieces of HTML that several sections of the page use. Texts are escaped here."""

from collections.abc import Iterable
from html import escape


def table(corner: str, columns: Iterable[str], rows: Iterable[str]) -> str:
    """A table that scrolls sideways if it is too wide; `rows` made by `row`."""
    head = "".join(f'<th scope="col">{escape(each)}</th>' for each in (corner, *columns))
    body = f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f'<div class="scroll" tabindex="0" role="region" aria-label="table"><table>{body}</table></div>'


def row(title: str, cells: Iterable[str], kind: str = "") -> str:
    """A row with its title; `cells` made by `cell`, `kind` a CSS class."""
    return f'<tr{css_class(kind)}><th scope="row">{escape(title)}</th>{"".join(cells)}</tr>'


def cell(text: str, *, best: bool = False, mark: str = "") -> str:
    """A cell, with `mark` before the text of the best one."""
    return f"<td{css_class('win' * best)}>{mark * best}{escape(text)}</td>"


def css_class(name: str) -> str:
    """The attribute that gives an element a CSS class; nothing for an empty name."""
    return f' class="{name}"' if name else ""
