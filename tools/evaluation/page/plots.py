"""Line plots as SVG text. Colours are CSS variables, so that they follow light and dark; a CSS class hides a series."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor

from tools.pictures.plot import Plot, round_step, ticks

_SIZE, _MARGINS = (400, 300), (40, 14, 30, 44)
_INSET = 12 / 322  # from the frame to the first and the last point, of the distance between these
_MOST_TICKS = 7
_LEAST_LEAD = 0.2  # dB or %: a plot of leads spans this much at least

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
    title: str, places: Sequence[float], labels: Sequence[str], series: Sequence[Series], axis: str, second: Sequence[str] = ()
) -> str:
    """The SVG element of a plot of PSNR in dB; the y axis covers what is shown at first.

    title: heading of the plot.
    places: x of each point, any unit, rising.
    labels, second: one or two lines of text below each x.
    series: the lines.
    axis: name of the x axis.
    """
    low, high, step = _range(series)
    beside = _INSET * (places[-1] - places[0]) or 1.0
    plot = Plot((places[0] - beside, places[-1] + beside), (low, high), _SIZE, _MARGINS)
    plot.text(plot.left, 16, title, "start", "title")
    plot.rows(ticks((low, high), step))
    for lines, below, kind in ((labels, 16, "tick"), (second, 29, "tick soft")):
        for place, text in zip(places, lines, strict=False):
            plot.text(plot.at(place, low)[0], plot.bottom + below, text, kind=kind)
    plot.text(plot.right, _SIZE[1] - 2, axis, "end", "tick soft")
    left, top, wide, tall = plot.left, plot.top, plot.right - plot.left, plot.bottom - plot.top
    # A nested SVG, because it clips the lines at the frame.
    plot.add(f'<svg x="{left}" y="{top}" width="{wide}" height="{tall}" viewBox="{left} {top} {wide} {tall}">')
    for each in series:
        _draw(plot, each, places, labels)
    plot.add("</svg>")
    return plot.drawn(f"{title}, PSNR in dB over {axis}")


@dataclass(frozen=True)
class Lead:
    """A line of `lead_plot`. points: leads over what it is compared with, None where there is none; the rest as in `Series`."""

    name: str
    title: str
    colour: str
    points: tuple[float | None, ...]
    dashed: bool = False
    shown: bool = True


def lead_plot(title: str, places: Sequence[float], labels: Sequence[str], lines: Sequence[Lead], axis: str) -> str:
    """The SVG element of a plot of leads around 0; `title` names the figure with its unit, the rest as in `line_plot`."""
    values = [0.0, *(value for each in lines for value in each.points if value is not None)]
    step = round_step(max(max(values) - min(values), _LEAST_LEAD), _MOST_TICKS)
    bottom, top = floor(min(values) / step) * step, ceil(max(values) / step) * step
    beside = _INSET * (places[-1] - places[0]) or 1.0
    plot = Plot((places[0] - beside, places[-1] + beside), (bottom, top if top > bottom else bottom + step), _SIZE, _MARGINS)
    plot.text(plot.left, 16, title, "start", "title")
    plot.rows(ticks((bottom, top), step))
    for place, text in zip(places, labels, strict=True):
        plot.text(plot.at(place, bottom)[0], plot.bottom + 16, text)
    plot.text(plot.right, _SIZE[1] - 2, axis, "end", "tick soft")
    for each in lines:
        known = [(x, value, label) for x, value, label in zip(places, each.points, labels, strict=True) if value is not None]
        plot.add(f'<g class="series" data-series="{escape(each.name)}" style="--line:{each.colour}">')
        if len(known) > 1:
            plot.line([(x, value) for x, value, _ in known], f"line{' dashed' * each.dashed}")
        for x, value, label in known:
            plot.dot(x, value, 3, f"{each.title}, {label}: {value:+.2f}")
        plot.add("</g>")
    return plot.drawn(f"{title}: lead over {axis}")


def legend(series: Iterable[Series | Lead]) -> str:
    """Checkboxes that switch the lines of the plots beside them, as a fieldset that the page's script shows."""
    boxes = "".join(
        f'<label style="--line:{each.colour}"><input type="checkbox" value="{each.name}"{" checked" * each.shown}>'
        f'<span class="swatch{" dashed" * each.dashed}"></span>{escape(each.title)}</label>'
        for each in series
    )
    return f'<fieldset class="legend" hidden>{boxes}</fieldset>'


def _draw(plot: Plot, series: Series, places: Sequence[float], labels: Sequence[str]) -> None:
    known = [(x, point, label) for x, point, label in zip(places, series.points, labels, strict=True) if point is not None]
    off = "" if series.shown else " off"
    plot.add(f'<g class="series{off}" data-series="{escape(series.name)}" style="--line:{series.colour}">')
    if len(known) > 1:
        lower, middle, upper = ([(x, point[each]) for x, point, _ in known] for each in range(3))
        if series.band:
            plot.line([*upper, *reversed(lower)], "band", "polygon")
        plot.line(middle, f"line{' dashed' * series.dashed}")
    for index, (x, (q25, q50, q75), label) in enumerate(known):
        tip = f"{series.title}, {label}: {q50:.1f} dB (25 % {q25:.1f}, 75 % {q75:.1f})"
        plot.dot(x, q50, 5.5 if series.marked == index else 3, tip)
    plot.add("</g>")


def _range(series: Sequence[Series]) -> tuple[float, float, float]:
    """(lowest, highest, step) of the y axis: round numbers around what is shown at first."""
    shown = [each for each in series if each.shown] or list(series)
    values = [value for each in shown for point in each.points if point for value in (point if each.band else point[1:2])]
    if not values:
        return 0.0, 1.0, 1.0
    low, high = min(values), max(values)
    step = max(1.0, round_step(high - low, _MOST_TICKS)) if high > low else 1.0
    bottom, top = floor(low / step) * step, ceil(high / step) * step
    return bottom, top if top > bottom else bottom + step, step
