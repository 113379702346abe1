"""The page: verdict, crops, a table and three plots, in one HTML file that needs no network."""

from collections.abc import Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..io.page import embed_picture, embed_plot, render_page
from .crops import Crop, Exhibit, Rendered
from .figures import CRITERIA, Figures, Place
from .measures import TITLES
from .metrics import BORDER, PSNR_PATCH
from .scene_sets import CROP
from .tables import describe, method_table
from .verdict import judge

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# matplotlib's ten colours; a further method has the first one again.
_FIRST = "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd"
_COLOURS = (*_FIRST, "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")
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
        "name": f"{name[:1].upper()}{name[1:]}",
        "count": len(figures.scenes(name)),
        "verdict": judge(figures, name),
        "table": method_table(figures, name),
        "plots": list(zip(TITLES, plots, strict=True)),
        "colours": list(zip(figures.study.methods, cycle(_COLOURS))),
    }


def draw_noise(figures: Figures, group: str, plane: int, axes: "Axes") -> None:
    """Draw the medians of a plane over the noise, a line for each method: ours solid, rivals
    dashed.
    """
    study, levels = figures.study, figures.study.levels
    places = range(len(levels))
    for name, colour in zip(study.methods, cycle(_COLOURS)):
        medians = [CRITERIA[plane].score(figures.of(Place(group, level), name)) for level in levels]
        style = "o-" if study.method(name).ours else "s--"
        width = 2.4 if name == study.ours else 1.3
        axes.plot(places, medians, style, linewidth=width, markersize=3.5, color=colour)
    axes.set_title(TITLES[plane], loc="left")
    axes.set_xticks(places, [f"{level.level:g}" for level in levels])
    axes.set_xlabel(levels[0].unit)
    axes.set_ylabel("median PSNR, dB")


def _describe(crop: Crop, pictures: Sequence[Rendered]) -> dict[str, Any]:
    """Return the template's variables for an exhibit."""
    return {
        "title": f"{crop.why[:1].upper()}{crop.why[1:]}",
        "where": f"{crop.scene.name}, {crop.level.text}, row {crop.row}, column {crop.column}",
        "pictures": [(item.title, item.psnr, embed_picture(item.pixels)) for item in pictures],
    }
