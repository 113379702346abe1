"""Line plots over noise as SVG text. Colours are CSS variables, so that they follow light and dark; a CSS class hides a series."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor

from tools.camera.protocols import Protocol
from tools.pictures.plot import Plot, round_step, ticks

_SIZE, _MARGINS = (400, 300), (40, 14, 30, 44)
_INSET = 12 / 322  # from the frame to the first and the last point, of the distance between these
_MOST_TICKS = 7
_LEAST_STEP, _LEAST_LEAD = 1.0, 0.2  # dB or %: between grid lines of a plot of PSNR; spanned by one of leads

Quartiles = tuple[float, float, float]


@dataclass(frozen=True)
class Series:
    """A line.

    name: one word, unique in the plot; ties the line to its entry in the legend.
    title: name for people.
    colour: CSS.
    points: 25 %, 50 % and 75 % quantile for each level, or a lead alone; None where there is none.
    band: shade the range between the quartiles.
    shown: visible at first.
    dashed: dash the line.
    """

    name: str
    title: str
    colour: str
    points: Sequence[Quartiles | float | None]
    band: bool = False
    shown: bool = True
    dashed: bool = False


def line_plot(title: str, levels: Sequence[Protocol], series: Sequence[Series], what: str = "PSNR in dB") -> str:
    """The SVG element of a plot over noise; the y axis covers what is shown at first, and 0 where leads are drawn.

    title: heading of the plot.
    levels: of the points of each series.
    what: is drawn, for people who hear the page.
    """
    places, axis = levels[0].places(levels), levels[0].axis
    low, high, step = _range([each for each in series if each.shown] or series)
    beside = _INSET * (places[-1] - places[0]) or 1.0
    plot = Plot((places[0] - beside, places[-1] + beside), (low, high), _SIZE, _MARGINS)
    plot.text(plot.left, 16, title, "start", "title")
    plot.rows(ticks((low, high), step))
    for place, level in zip(places, levels, strict=True):
        plot.text(plot.at(place, low)[0], plot.bottom + 16, level.tick)
    plot.text(plot.right, _SIZE[1] - 2, axis, "end", "tick soft")
    left, top, wide, tall = plot.left, plot.top, plot.right - plot.left, plot.bottom - plot.top
    # A nested SVG, because it clips the lines at the frame.
    plot.add(f'<svg x="{left}" y="{top}" width="{wide}" height="{tall}" viewBox="{left} {top} {wide} {tall}">')
    for each in series:
        _draw(plot, each, [(x, point, level) for x, point, level in zip(places, each.points, levels, strict=True)])
    plot.add("</svg>")
    return plot.drawn(f"{title}, {what} over {axis}")


def legend(series: Iterable[Series]) -> str:
    """Checkboxes that switch the lines of the plots beside them, as a fieldset that the page's script shows."""
    boxes = "".join(
        f'<label style="--line:{each.colour}"><input type="checkbox" value="{each.name}"{" checked" * each.shown}>'
        f'<span class="swatch{" dashed" * each.dashed}"></span>{escape(each.title)}</label>'
        for each in series
    )
    return f'<fieldset class="legend" hidden>{boxes}</fieldset>'


def _draw(plot: Plot, series: Series, points: Iterable[tuple[float, Quartiles | float | None, Protocol]]) -> None:
    known = [(x, _quartiles(point), level.tick, point) for x, point, level in points if point is not None]
    off = "" if series.shown else " off"
    plot.add(f'<g class="series{off}" data-series="{escape(series.name)}" style="--line:{series.colour}">')
    if len(known) > 1:
        lower, middle, upper = ([(x, quartiles[each]) for x, quartiles, *_ in known] for each in range(3))
        if series.band:
            plot.line([*upper, *reversed(lower)], "band", "polygon")
        plot.line(middle, f"line{' dashed' * series.dashed}")
    for x, (low, middle_, high), tick, point in known:
        said = f"{middle_:+.2f}" if isinstance(point, float) else f"{middle_:.1f} dB (25 % {low:.1f}, 75 % {high:.1f})"
        plot.dot(x, middle_, 3, f"{series.title}, {tick}: {said}")
    plot.add("</g>")


def _quartiles(point: Quartiles | float) -> Quartiles:
    return (point,) * 3 if isinstance(point, float) else point


def _range(series: Iterable[Series]) -> tuple[float, float, float]:
    """(lowest, highest, step) of the y axis: round numbers around the series."""
    points = [(point, each.band) for each in series for point in each.points if point is not None]
    values = [value for point, band in points for value in (_quartiles(point) if band else _quartiles(point)[1:2])]
    leads = any(isinstance(point, float) for point, _ in points)
    values += [0.0] * (leads or not values)
    low, high = min(values), max(values)
    least = round_step(_LEAST_LEAD, _MOST_TICKS) if leads else _LEAST_STEP
    step = max(least, round_step(high - low, _MOST_TICKS)) if high > low else least
    bottom, top = floor(low / step) * step, ceil(high / step) * step
    return bottom, top if top > bottom else bottom + step, step
