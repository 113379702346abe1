"""The plots of the page: quality over noise (the paper's Fig. 3), and over the period of the pattern."""

from html import escape

from shared import CfaPattern

from ..figures import RGB, Figure, Figures, title
from ..measures import PLANES
from ..methods import methods
from ..protocol import ORDER
from ..verdict import capital, heading, periods
from .svg import Series, line_plot

_OURS = ("--ours", "--ours-2", "--ours-3")
_RIVALS, _LEVELS = 9, 6
Point = tuple[float, float, float] | None
_PLANE_TITLES = ("RGB", "Luminance", "Chrominance")


def noise_plots(figures: Figures) -> str:
    """Fig. 3 for every set: medians and quartiles over the noise, lines to be switched on and off."""
    study = figures.study
    labels = [f"{level:g}" if study.protocol.kind == "paper" else _fraction(level) for level in study.levels]
    places = list(study.levels) if study.protocol.kind == "paper" else [float(index) for index in range(len(study.levels))]
    axis = "sigma" if study.protocol.kind == "paper" else "exposure"
    parts = ["<h2>Quality and noise</h2><p>Lines are medians, bands reach from the 25 % to the 75 % quantile of all patches.</p>"]
    for number, group in enumerate(figures.groups):
        parts.append(f"<div><h3>{escape(heading(figures, group))}</h3>")
        shown = _shown(figures, group)
        plots = []
        for plane, name in enumerate(_PLANE_TITLES):
            series = [
                Series(
                    each,
                    title(each),
                    _colour(figures, each),
                    _points(figures, group, each, plane),
                    each in shown[:3],
                    each in shown,
                    dashed=_dashed(figures, each),
                )
                for each in _drawn_last(figures)
            ]
            plots.append(line_plot(f"set{number}", name, places, labels, series, axis))
        parts.append(f'<div class="plots">{"".join(plots)}</div>')
        boxes = "".join(
            f'<label style="--line:{_colour(figures, each)}"><input type="checkbox" value="{each}"{" checked" * (each in shown)}>'
            f'<span class="swatch{" dashed" * _dashed(figures, each)}"></span>{escape(title(each))}</label>'
            for each in study.methods
        )
        parts.append(f'<fieldset class="legend" hidden>{boxes}</fieldset></div>')
    return "\n".join(parts)


def period_section(figures: Figures) -> str:
    """Light efficiency against quality, per noise level, and which period wins when."""
    study, own = figures.study, figures.ours
    if own is None:
        return ""
    light = [CfaPattern.bayer(period, ORDER).light_efficiency for period in study.periods]
    parts = [
        "<h2>How sparse should colour be?</h2><p>Few colour blocks (large K) collect more light and leave luminance sharper; many "
        f"give finer colour. Median RGB PSNR of {escape(title(own))}; below each K the light it collects, as a multiple of a Bayer "
        "sensor's. The large dot is the best K.</p>"
    ]
    for number, group in enumerate(figures.groups):
        rows, plots = [], []
        for plane, name in enumerate(_PLANE_TITLES):
            series = []
            for index, level in enumerate(study.levels):
                found = [figures.pooled(group, level, own, period) for period in study.periods]
                points = tuple(_of(figure, plane) for figure in found)
                known = [(point[1], place) for place, point in enumerate(p for p in points if p)]
                best = max(known)[1] if known else None
                text = study.protocol.describe(level)
                series.append(Series(f"level-{index}", text, f"var(--l{index % _LEVELS})", points, marked=best))
                if plane == RGB:
                    rows.append(_winner_row(text, study.periods, points))
            labels = [f"K={period}" for period in study.periods]
            second = [f"{each:.2f}×" for each in light]
            plots.append(line_plot(f"period{number}", name, [float(p) for p in study.periods], labels, series, "", second))
        boxes = "".join(
            f'<label style="--line:var(--l{index % _LEVELS})"><input type="checkbox" value="level-{index}" checked>'
            f'<span class="swatch"></span>{escape(capital(study.protocol.describe(level)))}</label>'
            for index, level in enumerate(study.levels)
        )
        head = "".join(f'<th scope="col">K = {period}</th>' for period in study.periods)
        table = f'<table><thead><tr><th scope="col">Median RGB, dB</th>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
        parts.append(
            f"<h3>{escape(heading(figures, group))}</h3><p>{escape(periods(figures, group))}</p>"
            f'<div><div class="plots">{"".join(plots)}</div>'
            f'<fieldset class="legend" hidden>{boxes}</fieldset></div>'
            f'<div class="scroll" tabindex="0" role="region" aria-label="table">{table}</div>'
        )
    return "\n".join(parts)


def _winner_row(text: str, periods: tuple[int, ...], points: tuple[Point, ...]) -> str:
    best = max((point[1] for point in points if point), default=None)
    cells = "".join(
        "<td>–</td>"
        if point is None
        else f'<td class="win">★ {point[1]:.1f}</td>'
        if point[1] == best
        else f"<td>{point[1]:.1f}</td>"
        for point, _ in zip(points, periods, strict=True)
    )
    return f'<tr><th scope="row">{escape(capital(text))}</th>{cells}</tr>'


def _shown(figures: Figures, group: str) -> list[str]:
    """What is drawn at first, with bands for the first three: ours, the paper's baseline, and the winners among the rivals."""
    winners = []
    for level in figures.study.levels:
        margin = figures.margin(group, level)
        winners += [margin[0]] if margin else []
    last = winners[-1:]
    ours = [figures.ours] if figures.ours else []
    baseline = [name for name in ("dlmmse", "menon", "bilinear") if name in figures.rivals][:1]
    return list(dict.fromkeys([*ours, *baseline, *last, *winners]))


def _drawn_last(figures: Figures) -> list[str]:
    """The methods, what matters most last, for later lines lie above earlier ones."""
    return sorted(figures.study.methods, key=lambda name: (name == figures.ours, methods()[name].ours))


def _colour(figures: Figures, name: str) -> str:
    ours = [each for each in figures.study.methods if methods()[each].ours]
    if name in ours:
        ours.sort(key=lambda each: each != figures.ours)
        return f"var({_OURS[ours.index(name) % len(_OURS)]})"
    return f"var(--r{figures.rivals.index(name) % _RIVALS})"


def _dashed(figures: Figures, name: str) -> bool:
    """Whether a rival's colour is one that another has too."""
    return name in figures.rivals and figures.rivals.index(name) >= _RIVALS


def _points(figures: Figures, group: str, name: str, plane: int) -> tuple[Point, ...]:
    found = [figures.pooled(group, level, name) for level in figures.study.levels]
    return tuple(_of(figure, plane) for figure in found)


def _of(figure: Figure | None, plane: int) -> Point:
    if figure is None:
        return None
    point: tuple[float, float, float] = getattr(figure.quality, PLANES[plane])
    return point


def _fraction(level: float) -> str:
    return f"1/{1 / level:g}" if 0 < level < 1 else f"{level:g}"
