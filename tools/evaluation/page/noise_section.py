"""The section of the page on quality over noise, after the paper's Fig. 3."""

from html import escape

from ..criteria import RGB
from ..figures import Figure, Figures, SetFigures
from ..measures import TITLES
from ..methods import methods
from ..verdict import capital, heading
from .plots import Quartiles, Series, legend, line_plot

_OURS = ("--ours", "--ours-2", "--ours-3", "--ours-4")
_RIVALS, _LEVELS = 9, 6  # colours of the style sheet


def noise_section(figures: Figures) -> str:
    """Quality over noise for every set: medians and quartiles, with lines that can be switched on and off."""
    study = figures.study
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
        plots = [line_plot(capital(name), study.levels, list(lines.values())) for name, lines in zip(TITLES, planes, strict=True)]
        parts.append(f"<div><h3>{escape(heading(group))}</h3>")
        parts.append(f'<div class="plots">{"".join(plots)}</div>')
        parts.append(f"{legend(planes[RGB][name] for name in study.methods)}</div>")
    return "\n".join(parts)


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
