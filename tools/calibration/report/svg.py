"""Small plots as inline SVG: sharp at any size, coloured by the page's style sheet, no files to load."""

import math
from collections.abc import Sequence
from html import escape

WIDTH, HEIGHT = 560, 340
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 14, 12, 46


class Axes:
    """One plot with its axes and grid.

    x, y: first and last value on each axis, in data coordinates.
    labels: of the two axes.
    log: whether both axes are logarithmic.
    height: of the plot, in SVG units; its width is WIDTH.
    """

    def __init__(
        self, x: tuple[float, float], y: tuple[float, float], labels: tuple[str, str], *, log: bool = False, height: int = HEIGHT
    ) -> None:
        self._x, self._y, self._log, self._height = x, y, log, height
        self._parts = [*self._grid(*labels)]

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the position of a point in SVG units."""
        return (
            _LEFT + self._part(x, self._x) * (WIDTH - _LEFT - _RIGHT),
            self._height - _BOTTOM - self._part(y, self._y) * (self._height - _TOP - _BOTTOM),
        )

    def dot(self, x: float, y: float, *, style: str, title: str, radius: float = 4.0) -> None:
        """Draw a disc; style: CSS; title: tooltip."""
        left, top = self.at(x, y)
        self._parts.append(
            f'<circle cx="{left:.1f}" cy="{top:.1f}" r="{radius:.1f}" style="{style}"><title>{escape(title)}</title></circle>'
        )

    def line(self, points: Sequence[tuple[float, float]], kind: str) -> None:
        """Draw a polyline of CSS class `kind`."""
        path = " ".join("{:.1f},{:.1f}".format(*self.at(*point)) for point in points)
        self._parts.append(f'<polyline points="{path}" class="{kind}"/>')

    def bar(self, x: float, y: float, width: float, *, style: str, title: str) -> None:
        """Draw a bar from 0 to y; style: CSS; title: tooltip."""
        left, top = self.at(x - width / 2, max(y, 0))
        right, bottom = self.at(x + width / 2, min(y, 0))
        self._parts.append(
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{max(bottom - top, 0.5):.1f}" '
            f'style="{style}"><title>{escape(title)}</title></rect>'
        )

    def drawn(self, description: str) -> str:
        """Return the SVG element."""
        return (
            f'<svg viewBox="0 0 {WIDTH} {self._height}" role="img" aria-label="{escape(description)}">'
            + "".join(self._parts)
            + "</svg>"
        )

    def _part(self, value: float, span: tuple[float, float]) -> float:
        low, high = span
        if self._log:
            low, high, value = math.log10(low), math.log10(high), math.log10(max(value, low * 1e-3))
        return min(max((value - low) / (high - low), -0.02), 1.02)

    def _grid(self, across: str, up: str) -> list[str]:
        bottom = self._height - _BOTTOM
        parts = []
        for tick in ticks(self._x, log=self._log):
            left, _ = self.at(tick, self._y[0])
            parts.append(f'<line x1="{left:.1f}" x2="{left:.1f}" y1="{_TOP}" y2="{bottom}" class="grid"/>')
            parts.append(f'<text x="{left:.1f}" y="{bottom + 16}" class="tick" text-anchor="middle">{tick:g}</text>')
        for tick in ticks(self._y, log=self._log):
            _, top = self.at(self._x[0], tick)
            parts.append(f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{top:.1f}" y2="{top:.1f}" class="grid"/>')
            parts.append(f'<text x="{_LEFT - 6}" y="{top + 4:.1f}" class="tick" text-anchor="end">{tick:g}</text>')
        middle, centre = (_TOP + bottom) / 2, (_LEFT + WIDTH - _RIGHT) / 2
        middling = 'class="label" text-anchor="middle"'
        parts.append(f'<text x="{centre}" y="{self._height - 8}" {middling}>{escape(across)}</text>')
        parts.append(f'<text transform="translate(14 {middle}) rotate(-90)" {middling}>{escape(up)}</text>')
        return parts


def ticks(span: tuple[float, float], *, log: bool = False) -> list[float]:
    """Return round numbers inside a span: about five, or the decades."""
    low, high = span
    if log:
        first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
        step = max(1, (last - first) // 5)
        return [10.0**power for power in range(first, last + 1, step)]
    rough = (high - low) / 5
    size = 10.0 ** math.floor(math.log10(rough))
    step_size = next(size * factor for factor in (1, 2, 5, 10) if size * factor >= rough)
    return [
        round(index * step_size, 12) for index in range(math.ceil(low / step_size - 1e-9), math.floor(high / step_size + 1e-9) + 1)
    ]
