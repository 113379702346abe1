"""The page: verdict, crops, a table and three plots, in one HTML file that needs no network; and
the plots of all sets in one SVG.
"""

from collections.abc import Sequence
from functools import partial
from itertools import cycle
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..io.page import draw_svg, embed_picture, embed_plot, render_page
from .crops import Crop, Exhibit, Rendered
from .figures import Figures, Place, judge
from .measures import PLANES, TITLES
from .metrics import BORDER, PSNR_PATCH
from .scene_sets import CROP
from .tables import describe, method_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# matplotlib's ten colours; a further method has the first one again.
_FIRST = "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd"
_LINE_COLOURS = (*_FIRST, "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")
_SPREAD = 0.3  # of the methods about their level of noise, so that their bars stand side by side
_TEMPLATE = Path(__file__).with_name("evaluation.html")


def build_page(
    figures: Figures, exhibits: Sequence[Exhibit], program: str, failures: Sequence[str]
) -> bytes:
    """Return the content of the page's file, UTF-8.

    Parameters
    ----------
    figures
        All results.
    exhibits
        Crops as `render_crops` makes them.
    program
        Name and version.
    failures
        A line for each scene or result that is missing.
    """
    study = figures.study
    groups = [_group(figures, name) for name in figures.groups]
    return render_page(
        _TEMPLATE,
        title="Is the sparse-colour camera better?",
        summary=describe(figures),
        groups=groups,
        exhibits=[_describe(*exhibit) for exhibit in exhibits],
        failures=failures,
        facts={"patch": PSNR_PATCH, "border": BORDER, "crop": CROP, "seed": study.seed},
        conditions=study.levels[0].conditions,
        program=program,
    )


def _group(figures: Figures, name: str) -> dict[str, Any]:
    """Return the template's variables for a set of scenes."""
    plots = [embed_plot(partial(draw_noise, figures, name, plane), 4.6, 3.6) for plane in range(3)]
    return {
        "name": _title(name),
        "count": len(figures.scenes(name)),
        "verdict": judge(figures, name),
        "table": method_table(figures, name),
        "plots": list(zip(TITLES, plots, strict=True)),
        "colours": list(zip(figures.study.methods, cycle(_LINE_COLOURS))),
    }


def plots_svg(figures: Figures) -> bytes:
    """Return the SVG of all plots: a row for each set, a column for each of RGB, luminance and
    chrominance.
    """

    def draw(figure: "Figure") -> None:
        rows = figure.subplots(len(figures.groups), len(PLANES), squeeze=False)
        for name, row in zip(figures.groups, rows, strict=True):
            for plane, axes in enumerate(row):
                draw_noise(figures, name, plane, axes)
            row[0].set_title(f"{_title(name)}: {TITLES[0]}", loc="left")
        lines = rows[0][0].containers
        figure.legend(lines, figures.study.methods, loc="outside lower center", ncols=4)

    return draw_svg(draw, 13.8, 3.6 * len(figures.groups) + 0.6)


def draw_noise(figures: Figures, group: str, plane: int, axes: "Axes") -> None:
    """Draw the medians of a plane over the noise, with bars from the lower to the upper quartile
    of the patches; a line for each method: ours solid, rivals dashed.
    """
    study, levels = figures.study, figures.study.levels
    offsets = np.linspace(-_SPREAD, _SPREAD, len(study.methods) + 2)[1:-1]
    for name, colour, offset in zip(study.methods, cycle(_LINE_COLOURS), offsets):
        found = [figures.of(Place(group, level), name) for level in levels]
        values: list[Any] = [figure.values if figure else {} for figure in found]
        quantiles = (f"{PLANES[plane]}_q{percent}" for percent in (25, 50, 75))
        low, median, high = np.array([[row.get(q, nan) for row in values] for q in quantiles])
        places, bars = np.arange(len(levels)) + offset, (median - low, high - median)
        line: Any = {"linewidth": 2.4 if name == study.ours else 1.3, "color": colour}
        line["fmt"] = "o-" if study.method(name).ours else "s--"
        axes.errorbar(places, median, bars, **line, elinewidth=1, capsize=2, markersize=3.5)
    axes.set_title(TITLES[plane], loc="left")
    axes.set_xticks(range(len(levels)), [f"{level.level:g}" for level in levels])
    axes.set_xlabel(levels[0].unit)
    axes.set_ylabel("PSNR, dB: median and quartiles")


def _title(group: str) -> str:
    return f"{group[:1].upper()}{group[1:]}"


def _describe(crop: Crop, pictures: Sequence[Rendered]) -> dict[str, Any]:
    """Return the template's variables for an exhibit."""
    return {
        "title": f"{crop.why[:1].upper()}{crop.why[1:]}",
        "where": f"{crop.scene.name}, {crop.level.text}, row {crop.row}, column {crop.column}",
        "pictures": [(item.title, item.psnr, embed_picture(item.pixels)) for item in pictures],
    }
