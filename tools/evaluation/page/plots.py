"""Quality over noise, after the paper's Fig. 3, as SVG text. Colours are CSS variables, so that they follow light and dark."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor

from tools.batch.plot import Plot, round_step, ticks
from tools.simulation.noise import Protocol

from ..figures import SetFigures
from ..measures import PLANES, TITLES
from ..methods import methods
from ..verdict import capital

_SIZE, _MARGINS = (400, 300), (40, 14, 30, 44)
_INSET = 12 / 322  # from the frame to the first and the last point, of the distance between these
_MOST_TICKS, _LEAST_STEP = 7, 1.0  # grid lines; dB between them
_QUARTILES = ("q25", "q50", "q75")
# Of the style sheet: of our methods, the rivals, and what is for any pattern.
_COLOURS = ("ours", "ours-2", "ours-3", "ours-4"), [f"r{number}" for number in range(9)], [f"l{number}" for number in range(6)]


@dataclass(frozen=True)
class Line:
    """How a method is drawn.

    name: of the method; ties its lines to their entry in the legend.
    colour: CSS.
    band: shade the range between the quartiles.
    shown: visible at first.
    dashed: dash the line.
    """

    name: str
    colour: str
    band: bool
    shown: bool
    dashed: bool

    @property
    def title(self) -> str:
        """Name for people."""
        return methods()[self.name].title


def noise_plots(group: SetFigures) -> str:
    """A plot of medians and quartiles for each plane, and a legend that switches their lines on and off."""
    lines = lines_of(group)
    plots = "".join(_plot(group, plane, title, lines) for plane, title in zip(PLANES, TITLES, strict=True))
    boxes = "".join(
        f'<label style="--line:{each.colour}"><input type="checkbox" value="{escape(each.name)}"{" checked" * each.shown}>'
        f'<span class="swatch{" dashed" * each.dashed}"></span>{escape(each.title)}</label>'
        for each in lines
    )
    return f'<div><div class="plots">{plots}</div><fieldset class="legend" hidden>{boxes}</fieldset></div>'


def lines_of(group: SetFigures) -> list[Line]:
    """The methods of a study. Drawn at first, the first three with bands: ours, the paper's rival, the best rivals, the paper's."""
    study = group.study
    winners = [margin.rival for level in study.levels if (margin := group.margin(level))]  # in most noise first
    papers = [name for name in ("dlmmse", "menon", "bilinear") if name in study.rivals][:1]
    shown = list(dict.fromkeys([*filter(None, [study.ours]), *papers, *winners[-1:], *winners, "paper"]))
    ours = sorted((name for name in study.methods if methods()[name].ours), key=lambda name: name != study.ours)
    others = [name for name in study.methods if name not in (*ours, *study.rivals)]
    found = {}
    for kind, colours in zip((ours, study.rivals, others), _COLOURS, strict=True):
        for place, name in enumerate(kind):
            colour = f"var(--{colours[place % len(colours)]})"
            found[name] = Line(name, colour, name in shown[:3], name in shown, dashed=place >= len(colours))
    return [found[name] for name in study.methods]


def _plot(group: SetFigures, plane: str, title: str, lines: Sequence[Line]) -> str:
    """The SVG element of a plot of PSNR over noise; the y axis covers what is shown at first."""
    levels, points = group.study.levels, {each.name: _quartiles(group, plane, each.name) for each in lines}
    places, axis = levels[0].places(levels), levels[0].axis
    low, high, step = _range([each for each in lines if each.shown] or lines, points)
    beside = _INSET * (places[-1] - places[0]) or 1.0
    plot = Plot((places[0] - beside, places[-1] + beside), (low, high), _SIZE, _MARGINS)
    plot.text(plot.left, 16, capital(title), "start", "title")
    plot.rows(ticks((low, high), step))
    for place, level in zip(places, levels, strict=True):
        plot.text(plot.at(place, low)[0], plot.bottom + 16, level.tick)
    plot.text(plot.right, _SIZE[1] - 2, axis, "end", "tick soft")
    left, top, wide, tall = plot.left, plot.top, plot.right - plot.left, plot.bottom - plot.top
    # A nested SVG, because it clips the lines at the frame. The most important lines are drawn last, above the others.
    plot.add(f'<svg x="{left}" y="{top}" width="{wide}" height="{tall}" viewBox="{left} {top} {wide} {tall}">')
    for each in sorted(lines, key=lambda line: (line.name == group.study.ours, methods()[line.name].ours)):
        _draw(plot, each, zip(places, points[each.name], levels, strict=True))
    plot.add("</svg>")
    return plot.drawn(f"{capital(title)}, PSNR in dB over {axis}")


def _quartiles(group: SetFigures, plane: str, name: str) -> list[list[float] | None]:
    """25 %, 50 % and 75 % quantile of a method at each level; None where there is none."""
    figures = [group.figure(level, name) for level in group.study.levels]
    return [[each.values[f"{plane}_{quartile}"] or 0.0 for quartile in _QUARTILES] if each else None for each in figures]


def _draw(plot: Plot, line: Line, points: Iterable[tuple[float, list[float] | None, Protocol]]) -> None:
    known = [(x, quartiles, level.tick) for x, quartiles, level in points if quartiles]
    off = "" if line.shown else " off"
    plot.add(f'<g class="series{off}" data-series="{escape(line.name)}" style="--line:{line.colour}">')
    if len(known) > 1:
        lower, middle, upper = ([(x, quartiles[each]) for x, quartiles, _ in known] for each in range(3))
        if line.band:
            plot.line([*upper, *reversed(lower)], "band", "polygon")
        plot.line(middle, f"line{' dashed' * line.dashed}")
    for x, (low, median, high), tick in known:
        plot.dot(x, median, 3, f"{line.title}, {tick}: {median:.1f} dB (25 % {low:.1f}, 75 % {high:.1f})")
    plot.add("</g>")


def _range(lines: Iterable[Line], points: dict[str, list[list[float] | None]]) -> tuple[float, float, float]:
    """(lowest, highest, step) of the y axis: round numbers around the lines."""
    values = [value for each in lines for point in points[each.name] if point for value in (point if each.band else point[1:2])]
    low, high = min(values, default=0.0), max(values, default=0.0)
    step = max(_LEAST_STEP, round_step(high - low, _MOST_TICKS)) if high > low else _LEAST_STEP
    bottom, top = floor(low / step) * step, ceil(high / step) * step
    return bottom, top if top > bottom else bottom + step, step
