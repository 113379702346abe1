"""Plots as inline SVG: sharp at any size, coloured by the page's style sheet, no files to load."""

import math
from collections.abc import Iterable, Sequence
from html import escape

Span = tuple[float, float]


class Plot:
    """A plot in a frame, whose edges are `left`, `right`, `top` and `bottom` in SVG units.

    x, y: first and last value on each axis.
    size: width and height, SVG units.
    margins: between the frame and the edges of the plot: left, right, top and bottom.
    log: whether both axes are logarithmic.
    """

    def __init__(self, x: Span, y: Span, size: Span, margins: tuple[float, float, float, float], *, log: bool = False) -> None:
        self.left, self.top = margins[0], margins[2]
        self.right, self.bottom = size[0] - margins[1], size[1] - margins[3]
        self._x, self._y, self._size, self._scale = x, y, size, math.log10 if log else float
        self._parts: list[str] = []

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the position of a point in SVG units."""
        across, up = (
            (self._scale(value) - self._scale(low)) / (self._scale(high) - self._scale(low))
            for value, (low, high) in ((x, self._x), (y, self._y))
        )
        return self.left + across * (self.right - self.left), self.bottom - up * (self.bottom - self.top)

    def add(self, part: str) -> None:
        """Draw SVG elements, or begin or end one."""
        self._parts.append(part)

    def text(self, x: float, y: float, text: str, anchor: str = "middle", kind: str = "tick") -> None:
        """Write a line of text at a position in SVG units. anchor: the end of the text that is there; kind: CSS classes."""
        self.add(f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>')

    def rows(self, values: Iterable[float]) -> None:
        """Draw grid lines at values of y, with the values beside them."""
        for value in values:
            y = self.at(self._x[0], value)[1]
            self.add(f'<line class="grid" x1="{self.left:g}" x2="{self.right:g}" y1="{y:.1f}" y2="{y:.1f}"/>')
            self.text(self.left - 6, y + 4, f"{value:g}", "end")

    def columns(self, values: Iterable[float]) -> None:
        """Draw grid lines at values of x, with the values below them."""
        for value in values:
            x = self.at(value, self._y[0])[0]
            self.add(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{self.top:g}" y2="{self.bottom:g}"/>')
            self.text(x, self.bottom + 16, f"{value:g}")

    def name_axes(self, across: str, up: str) -> None:
        """Write the names of both axes below and beside the frame."""
        self.text((self.left + self.right) / 2, self._size[1] - 8, across)
        self.add(f'<g transform="translate(14 {(self.top + self.bottom) / 2}) rotate(-90)">')
        self.text(0, 0, up)
        self.add("</g>")

    def line(self, points: Iterable[Span], kind: str, element: str = "polyline") -> None:
        """Draw a line of CSS class `kind` through points; element: or "polygon", the area inside."""
        path = " ".join("{:.1f},{:.1f}".format(*self.at(*point)) for point in points)
        self.add(f'<{element} class="{kind}" points="{path}"/>')

    def dot(self, x: float, y: float, radius: float, title: str, style: str = "") -> None:
        """Draw a disc; title: tooltip; style: CSS, besides that of the class `point`."""
        left, top = self.at(x, y)
        look = f' style="{style}"' if style else ""
        self.add(f'<circle class="point" cx="{left:.1f}" cy="{top:.1f}" r="{radius:g}"{look}>{_tooltip(title)}</circle>')

    def drawn(self, description: str) -> str:
        """Return the SVG element."""
        box = "0 0 {:g} {:g}".format(*self._size)
        return f'<svg class="plot" viewBox="{box}" role="img" aria-label="{escape(description)}">{"".join(self._parts)}</svg>'


def round_step(length: float, most: int) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that divides a length into at most `most` parts."""
    size = 10.0 ** math.floor(math.log10(length / most))
    return next(size * factor for factor in (1, 2, 5, 10) if size * factor * most >= length)


def ticks(span: Sequence[float], step: float) -> list[float]:
    """Return the multiples of a step inside a span."""
    first, last = math.ceil(span[0] / step - 1e-9), math.floor(span[1] / step + 1e-9)
    return [round(index * step, 12) for index in range(first, last + 1)]


def _tooltip(text: str) -> str:
    return f"<title>{escape(text)}</title>"
