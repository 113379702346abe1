"""The sections of the page that have plots: quality over noise (the paper's Fig. 3), and over the period of the pattern."""

from collections.abc import Sequence
from html import escape

from tools.pictures.html import cell, row, row_title, table

from ..criteria import RGB
from ..figures import Figure, Figures, SetFigures
from ..measures import TITLES
from ..methods import methods
from ..tiles import Tile
from ..verdict import capital, heading, periods
from .plots import Quartiles, Series, legend, line_plot

_OURS = ("--ours", "--ours-2", "--ours-3", "--ours-4")
_RIVALS, _LEVELS = 9, 6  # colours of the style sheet


def noise_section(figures: Figures) -> str:
    """Quality over noise for every set: medians and quartiles, with lines that can be switched on and off."""
    study = figures.study
    labels, places, axis = [level.tick for level in study.levels], study.protocol.places(study.levels), study.levels[0].axis
    parts = ["<h2>Quality and noise</h2><p>Lines are medians, bands reach from the 25 % to the 75 % quantile of all patches.</p>"]
    for group in figures.sets:
        shown = _shown(group)
        planes = [
            {
                name: Series(
                    name,
                    methods()[name].title,
                    _colour(figures, name),
                    tuple(_quartiles(group.pooled(level, name), plane) for level in study.levels),
                    name in shown[:3],
                    name in shown,
                    dashed=_dashed(figures, name),
                )
                for name in _drawn_last(figures)
            }
            for plane in range(len(TITLES))
        ]
        plots = [
            line_plot(capital(name), places, labels, list(lines.values()), axis) for name, lines in zip(TITLES, planes, strict=True)
        ]
        parts.append(f"<div><h3>{escape(heading(group))}</h3>")
        parts.append(f'<div class="plots">{"".join(plots)}</div>')
        parts.append(f"{legend(planes[RGB][name] for name in study.methods)}</div>")
    return "\n".join(parts)


def period_section(figures: Figures) -> str:
    """Quality over the period for every set and level, with the light that each period collects, and the best period."""
    study, own = figures.study, figures.study.ours
    if own is None:
        return ""
    light = [f"{Tile.of_period(period).pattern.light_efficiency:.2f}×" for period in study.periods]
    parts = [
        "<h2>How sparse should colour be?</h2><p>Few colour blocks (large K) collect more light and leave luminance sharper; many "
        f"give finer colour. Median RGB PSNR of {escape(methods()[own].title)}; below each K the light it collects, as a multiple "
        "of a Bayer sensor's. The large dot is the best K.</p>"
    ]
    labels = [f"K={period}" for period in study.periods]
    for group in figures.sets:
        planes = [_period_lines(group, own, plane) for plane in range(len(TITLES))]
        plots = [
            line_plot(capital(name), [float(period) for period in study.periods], labels, lines, "", light)
            for name, lines in zip(TITLES, planes, strict=True)
        ]
        rows = [row([row_title(line.title), *_cells(line.points)]) for line in planes[RGB]]
        parts.append(
            f"<h3>{escape(heading(group))}</h3><p>{escape(periods(group))}</p>"
            f'<div><div class="plots">{"".join(plots)}</div>{legend(planes[RGB])}</div>'
            f"{table(['Median RGB, dB', *(f'K = {period}' for period in study.periods)], rows)}"
        )
    return "\n".join(parts)


def _period_lines(group: SetFigures, own: str, plane: int) -> list[Series]:
    """One line per level, with its best period marked."""
    lines = []
    for index, level in enumerate(group.study.levels):
        points = tuple(_quartiles(group.pooled(level, own, Tile.of_period(period)), plane) for period in group.study.periods)
        medians = [point[1] for point in points if point]
        best = max(((median, place) for place, median in enumerate(medians)), default=(0.0, None))[1]
        title = capital(level.text)
        lines.append(Series(f"level-{index}", title, f"var(--l{index % _LEVELS})", points, marked=best))
    return lines


def _cells(points: Sequence[Quartiles | None]) -> list[str]:
    best = max((point[1] for point in points if point), default=None)
    return [cell(f"{point[1]:.1f}", best=point[1] == best, mark="★ ") if point else cell("–") for point in points]


def _shown(group: SetFigures) -> list[str]:
    """Methods drawn at first, the first three with bands: ours, the paper's rival, the best rivals (in most noise first)."""
    winners = [margin[0] for level in group.study.levels if (margin := group.at(level).margin()) is not None]
    ours = [group.study.ours] if group.study.ours else []
    papers = [name for name in ("dlmmse", "menon", "bilinear") if name in group.study.rivals][:1]
    return list(dict.fromkeys([*ours, *papers, *winners[-1:], *winners]))


def _drawn_last(figures: Figures) -> list[str]:
    """The methods with the most important last, because later lines lie above earlier ones."""
    return sorted(figures.study.methods, key=lambda name: (name == figures.study.ours, methods()[name].ours))


def _colour(figures: Figures, name: str) -> str:
    ours = [each for each in figures.study.methods if methods()[each].ours]
    if name in ours:
        ours.sort(key=lambda each: each != figures.study.ours)
        return f"var({_OURS[ours.index(name) % len(_OURS)]})"
    if name not in figures.study.rivals:  # what is for any pattern: few enough for the colours of the levels
        others = [each for each in figures.study.methods if each not in ours and each not in figures.study.rivals]
        return f"var(--l{others.index(name) % _LEVELS})"
    return f"var(--r{figures.study.rivals.index(name) % _RIVALS})"


def _dashed(figures: Figures, name: str) -> bool:
    """Whether a rival's colour is that of another one, too."""
    return name in figures.study.rivals and figures.study.rivals.index(name) >= _RIVALS


def _quartiles(figure: Figure | None, plane: int) -> Quartiles | None:
    return figure.quality[plane][1:] if figure else None
