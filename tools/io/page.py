"""HTML pages in one file that need no network: jinja2's templates, with pictures and plots inside
the page.
"""

import base64
import io
import os
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...shared.arrays import ByteArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# page.html, which others extend, and parts.html, whose macros they import
_SHARED = Path(__file__).with_name("pages")
_WIDEST = 1200  # pixels of a photograph on a page


def render_page(template: Path, **values: Any) -> bytes:
    """Return the content of a page's file.

    Parameters
    ----------
    template
        A template of jinja2 that begins with ``{% extends "page.html" %}`` and fills its blocks
        ``style`` (CSS beyond that of
        all pages) and ``body``. It may import the macros of ``parts.html``.
    **values
        Variables of the template; ``title``, the title of the page, is one of them. Every text is
        escaped.

    Returns
    -------
    bytes
        UTF-8. The page runs no script and loads nothing: its Content-Security-Policy forbids both.
    """
    import jinja2

    files, strict = jinja2.FileSystemLoader([template.parent, _SHARED]), jinja2.StrictUndefined
    blocks: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True}
    environment = jinja2.Environment(loader=files, autoescape=True, undefined=strict, **blocks)
    page = environment.get_template(template.name).render(**values)
    # names of files may hold bytes that are no characters
    return page.encode("utf-8", "backslashreplace")


def embed_picture(pixels: ByteArray, *, photograph: bool = False) -> str:
    """Return the address (``src``) of a picture inside the page.

    Parameters
    ----------
    pixels
        uint8 RGB (H, W, 3).
    photograph
        Reduce it to the width of a page if it is larger, and store it as JPEG; otherwise it is PNG,
        every pixel as it is.
    """
    from PIL import Image

    image, file = Image.fromarray(np.ascontiguousarray(pixels)), io.BytesIO()
    if photograph:
        image.thumbnail((_WIDEST, _WIDEST))
        image.save(file, "JPEG", quality=88, subsampling=0)
        return _address("image/jpeg", file)
    image.save(file, "PNG", optimize=True)
    return _address("image/png", file)


def embed_plot(draw: Callable[["Axes"], None], width: float = 5.6, height: float = 3.4) -> str:
    """Return the address (``src``) of a plot inside the page: see `draw_svg`, but `draw` is given
    axes.
    """
    file = io.BytesIO(draw_svg(lambda figure: draw(figure.subplots()), width, height))
    return _address("image/svg+xml", file)


def draw_svg(draw: Callable[["Figure"], None], width: float, height: float) -> bytes:
    """Return the SVG of a figure on white; the same figure has the same bytes.

    draw: draws into the figure that it is given, with matplotlib's methods. Its texts consist of
    printable characters. width, height: inches; an inch is 72 CSS pixels where the page does not
    scale the plot.
    """
    from .plotting import SETTINGS, Figure, matplotlib

    file = io.BytesIO()
    with matplotlib.rc_context(SETTINGS), warnings.catch_warnings():
        # the browser has the font that matplotlib lacks
        warnings.filterwarnings("ignore", message="Glyph")
        figure = Figure((width, height), layout="constrained")
        draw(figure)
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def without_folders(line: str, names: Iterable[str]) -> str:
    """Return a line without the absolute places of the files or folders that it names: a page is
    shared, these are private.

    Examples
    --------
    >>> without_folders("/home/me/photos/x.png: is empty", ["/home/me/photos"])
    'photos/x.png: is empty'
    """
    for name in names:
        for place in (str(Path(name).absolute()), os.path.realpath(name)):
            line = line.replace(place, Path(place).name or place)
    return line


def _address(kind: str, file: io.BytesIO) -> str:
    return f"data:{kind};base64,{base64.b64encode(file.getvalue()).decode()}"
