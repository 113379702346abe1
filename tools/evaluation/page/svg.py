"""Line plots as SVG text. Colours are CSS variables, so that they follow light and dark; a CSS class hides a series."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor

_WIDTH, _HEIGHT = 400.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 40.0, 14.0, 30.0, 44.0
_INSET = 12.0  # from the frame to the first and the last point
_TICKS = (1, 2, 5, 10, 20, 50)
_MOST_TICKS = 7

Quartiles = tuple[float, float, float]


@dataclass(frozen=True)
class Series:
    """A line.

    name: one word, unique in the plot; ties the line to its entry in the legend.
    title: name for people.
    colour: CSS.
    points: 25 %, 50 % and 75 % quantile for each x; None where there is none.
    band: shade the range between the quartiles.
    shown: visible at first.
    marked: index of the point with a large dot, among those that are not None.
    dashed: dash the line.
    """

    name: str
    title: str
    colour: str
    points: tuple[Quartiles | None, ...]
    band: bool = False
    shown: bool = True
    marked: int | None = None
    dashed: bool = False


def line_plot(
    name: str,
    title: str,
    places: Sequence[float],
    labels: Sequence[str],
    series: Sequence[Series],
    axis: str,
    second: Sequence[str] = (),
) -> str:
    """The SVG element of a plot of PSNR in dB; the y axis covers what is shown at first.

    name: unique on the page together with `title`.
    title: heading of the plot.
    places: x of each point, any unit, rising.
    labels, second: one or two lines of text below each x.
    series: the lines.
    axis: name of the x axis.
    """
    low, high, step = _range(series)
    span = places[-1] - places[0] or 1.0
    across = [_LEFT + _INSET + (place - places[0]) / span * (_WIDTH - _LEFT - _RIGHT - 2 * _INSET) for place in places]
    if len(places) == 1:
        across = [(_LEFT + _WIDTH - _RIGHT) / 2]

    def down(value: float) -> float:
        return _TOP + (high - value) / (high - low) * (_HEIGHT - _TOP - _BOTTOM)

    clip = "clip-" + "".join(letter for letter in f"{name}{title}" if letter.isalnum())
    parts = [
        f'<svg class="plot" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="{escape(f"{title}, PSNR in dB over {axis}")}">',
        f'<clipPath id="{clip}"><rect x="{_LEFT:g}" y="{_TOP:g}" width="{_WIDTH - _LEFT - _RIGHT:g}" '
        f'height="{_HEIGHT - _TOP - _BOTTOM:g}"/></clipPath>',
        f'<text class="title" x="{_LEFT:g}" y="16">{escape(title)}</text>',
    ]
    for index in range(round((high - low) / step) + 1):
        value = low + index * step
        y = down(value)
        parts.append(f'<line class="grid" x1="{_LEFT:g}" x2="{_WIDTH - _RIGHT:g}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(_text(_LEFT - 6, f"{y + 4:.1f}", "end", f"{value:g}"))
    for lines, y, kind in ((labels, 16, ""), (second, 29, " soft")):
        for x, text in zip(across, lines, strict=False):
            parts.append(_text(f"{x:.1f}", _HEIGHT - _BOTTOM + y, "middle", text, kind))
    parts.append(_text(_WIDTH - _RIGHT, _HEIGHT - 2, "end", axis, " soft"))
    parts.append(f'<g clip-path="url(#{clip})">')
    parts += [_line(each, across, down, labels) for each in series]
    return "".join([*parts, "</g></svg>"])


def legend(series: Iterable[Series]) -> str:
    """Checkboxes that switch the lines of the plots beside them, as a fieldset that the page's script shows."""
    boxes = "".join(
        f'<label style="--line:{each.colour}"><input type="checkbox" value="{each.name}"{" checked" * each.shown}>'
        f'<span class="swatch{" dashed" * each.dashed}"></span>{escape(each.title)}</label>'
        for each in series
    )
    return f'<fieldset class="legend" hidden>{boxes}</fieldset>'


def _text(x: float | str, y: float | str, anchor: str, text: str, kind: str = "") -> str:
    x, y = (place if isinstance(place, str) else f"{place:g}" for place in (x, y))
    return f'<text class="tick{kind}" x="{x}" y="{y}" text-anchor="{anchor}">{escape(text)}</text>'


def _line(series: Series, across: Sequence[float], down: Callable[[float], float], labels: Sequence[str]) -> str:
    known = [(x, point, label) for x, point, label in zip(across, series.points, labels, strict=True) if point is not None]
    off = "" if series.shown else " off"
    parts = [f'<g class="series{off}" data-series="{escape(series.name)}" style="--line:{series.colour}">']
    if len(known) > 1:
        lower, middle, upper = ([f"{x:.1f},{down(point[each]):.1f}" for x, point, _ in known] for each in range(3))
        if series.band:
            parts.append(f'<polygon class="band" points="{" ".join([*upper, *reversed(lower)])}"/>')
        parts.append(f'<polyline class="line{" dashed" * series.dashed}" points="{" ".join(middle)}"/>')
    for index, (x, (q25, q50, q75), label) in enumerate(known):
        tip = f"{series.title}, {label}: {q50:.1f} dB (25 % {q25:.1f}, 75 % {q75:.1f})"
        radius = 5.5 if series.marked == index else 3
        parts.append(f'<circle class="point" cx="{x:.1f}" cy="{down(q50):.1f}" r="{radius}"><title>{escape(tip)}</title></circle>')
    return "".join([*parts, "</g>"])


def _range(series: Sequence[Series]) -> tuple[float, float, float]:
    """(lowest, highest, step) of the y axis: round numbers around what is shown at first."""
    shown = [each for each in series if each.shown] or list(series)
    values = [value for each in shown for point in each.points if point for value in (point if each.band else point[1:2])]
    if not values:
        return 0.0, 1.0, 1.0
    low, high = min(values), max(values)
    step = next((tick for tick in _TICKS if (high - low) / tick <= _MOST_TICKS), _TICKS[-1])
    bottom, top = floor(low / step) * step, ceil(high / step) * step
    return float(bottom), float(top if top > bottom else bottom + step), float(step)
