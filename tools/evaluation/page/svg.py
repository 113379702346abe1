"""Line plots as SVG text: colours are CSS, so that they follow light and dark; a class switches a series off."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor

_WIDTH, _HEIGHT = 400.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 40.0, 14.0, 30.0, 44.0
_TICKS = (1, 2, 5, 10, 20, 50)
_MOST_TICKS = 7


@dataclass(frozen=True)
class Series:
    """A line: name (a word, becomes its class), title for people, CSS colour; per x the 25 %, 50 % and 75 % quantile, or None."""

    name: str
    title: str
    colour: str
    points: tuple[tuple[float, float, float] | None, ...]
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
    """An SVG element. name: with the title unique on the page; places: x of each point, any unit, rising; labels, second: lines of
    text below each; axis: what x is.

    The y axis is PSNR in dB, over the range of what is shown at first.
    """
    low, high, step = _range(series)
    span = places[-1] - places[0] or 1.0
    across = [_LEFT + 12 + (place - places[0]) / span * (_WIDTH - _LEFT - _RIGHT - 24) for place in places]
    if len(places) == 1:
        across = [(_LEFT + _WIDTH - _RIGHT) / 2]

    def down(value: float) -> float:
        return _TOP + (high - value) / (high - low) * (_HEIGHT - _TOP - _BOTTOM)

    clip = "clip-" + "".join(letter for letter in f"{name}{title}" if letter.isalnum())
    label = escape(f"{title}, PSNR in dB over {axis}")
    parts = [
        f'<svg class="plot" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{label}">',
        f'<clipPath id="{clip}"><rect x="{_LEFT:g}" y="{_TOP:g}" width="{_WIDTH - _LEFT - _RIGHT:g}" '
        f'height="{_HEIGHT - _TOP - _BOTTOM:g}"/></clipPath>',
        f'<text class="title" x="{_LEFT:g}" y="16">{escape(title)}</text>',
    ]
    value = low
    while value <= high + 1e-9:
        y = down(value)
        parts.append(f'<line class="grid" x1="{_LEFT:g}" x2="{_WIDTH - _RIGHT:g}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="tick" x="{_LEFT - 6:g}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
        value += step
    for index, (x, label) in enumerate(zip(across, labels, strict=True)):
        parts.append(f'<text class="tick" x="{x:.1f}" y="{_HEIGHT - _BOTTOM + 16:g}" text-anchor="middle">{escape(label)}</text>')
        if second:
            text = escape(second[index])
            parts.append(f'<text class="tick soft" x="{x:.1f}" y="{_HEIGHT - _BOTTOM + 29:g}" text-anchor="middle">{text}</text>')
    parts.append(f'<text class="tick soft" x="{_WIDTH - _RIGHT:g}" y="{_HEIGHT - 2:g}" text-anchor="end">{escape(axis)}</text>')
    parts.append(f'<g clip-path="url(#{clip})">')
    parts += [_drawn(each, across, down, labels) for each in series]
    return "".join([*parts, "</g></svg>"])


def _drawn(series: Series, across: Sequence[float], down: Callable[[float], float], labels: Sequence[str]) -> str:
    known = [(x, point, label) for x, point, label in zip(across, series.points, labels, strict=True) if point is not None]
    off = "" if series.shown else " off"
    parts = [f'<g class="series{off}" data-series="{escape(series.name)}" style="--line:{series.colour}">']
    if series.band and len(known) > 1:
        upper = " ".join(f"{x:.1f},{down(point[2]):.1f}" for x, point, _ in known)
        lower = " ".join(f"{x:.1f},{down(point[0]):.1f}" for x, point, _ in reversed(known))
        parts.append(f'<polygon class="band" points="{upper} {lower}"/>')
    if len(known) > 1:
        dashed = " dashed" if series.dashed else ""
        parts.append(f'<polyline class="line{dashed}" points="{" ".join(f"{x:.1f},{down(p[1]):.1f}" for x, p, _ in known)}"/>')
    for index, (x, (q25, q50, q75), label) in enumerate(known):
        said = f"{series.title}, {label}: {q50:.1f} dB (25 % {q25:.1f}, 75 % {q75:.1f})"
        radius = 5.5 if series.marked == index else 3
        parts.append(f'<circle class="point" cx="{x:.1f}" cy="{down(q50):.1f}" r="{radius}"><title>{escape(said)}</title></circle>')
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
