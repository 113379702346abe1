"""Pieces of HTML for the report: lists, tables, pictures, figures."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape

from shared.arrays import ByteArray

_WIDEST = 1200  # pixels of a picture


def bullets(sentences: Sequence[str]) -> str:
    """Return a list, "" if there is nothing to list."""
    return "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "</ul>" if sentences else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; without a head if `head` is empty."""
    top = "<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>" if head else ""
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table>{top}{body}</table></div>'


def figure(content: str, caption: str = "") -> str:
    """Return a figure. content: HTML; caption: text."""
    return f"<figure>{content}" + (f"<figcaption>{escape(caption)}</figcaption>" if caption else "") + "</figure>"


def picture(pixels: ByteArray, description: str) -> str:
    """Return uint8 RGB (H, W, 3) as an image inside the page, reduced if it is large."""
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((_WIDEST, _WIDEST))
    data = io.BytesIO()
    image.save(data, "JPEG", quality=85)
    return f'<img src="data:image/jpeg;base64,{base64.b64encode(data.getvalue()).decode()}" alt="{escape(description)}">'
