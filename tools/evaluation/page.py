"""The page: verdict, two pairs of crops, a table, three plots and the worst places, in one HTML file that needs no network."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools.io.page import embed_picture, embed_plot, render_page

from .crops import AHEAD, BEHIND, Exhibit
from .figures import Figures
from .measures import PLANES, TITLES
from .metrics import BORDER, PSNR_PATCH
from .scene_sets import CROP
from .tables import describe, method_table
from .verdict import judge

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TEMPLATE = Path(__file__).with_name("evaluation.html")


def build_page(figures: Figures, exhibits: Sequence[Exhibit], program: str, failures: Sequence[str]) -> bytes:
    """Return the content of the page's file.

    figures: all results.
    exhibits: as `render_crops` makes them.
    program: name and version.
    failures: a line for each scene or result that is missing, and for each folder of which a part is left out.
    """
    study = figures.study
    pairs = [_clearest(exhibits, why) for why in (AHEAD, BEHIND)]
    groups = [
        {
            "name": f"{name[:1].upper()}{name[1:]}",
            "count": len(figures.scenes(name)),
            "verdict": judge(figures, name),
            "table": method_table(figures, name),
            "plots": [
                (title, embed_plot(partial(draw_noise, figures, name, plane), 4.6, 4.2))
                for plane, title in zip(PLANES, TITLES, strict=True)
            ],
        }
        for name in figures.groups
    ]
    return render_page(
        _TEMPLATE,
        title="Is the sparse-colour camera better?",
        summary=describe(figures),
        groups=groups,
        pairs=[_shown(each) for each in pairs if each],
        worst=[_shown(each) for each in exhibits if each.crop.why not in (AHEAD, BEHIND)],
        failures=failures,
        facts={"patch": PSNR_PATCH, "border": BORDER, "crop": CROP, "seed": study.seed},
        conditions=study.protocol.conditions,
        program=program,
    )


def draw_noise(figures: Figures, group: str, plane: str, axes: "Axes") -> None:
    """Draw the medians of a plane over the noise, a line for each method: ours solid, rivals dashed."""
    study, levels = figures.study, figures.study.levels
    places = levels[0].places(levels)
    for name in study.methods:
        found = [figures.of(group, level, name) for level in levels]
        points = [(x, figure.values[f"{plane}_q50"]) for x, figure in zip(places, found, strict=True) if figure]
        if points:
            method = study.method(name)
            style: dict[str, Any] = {"linewidth": 2.4} if name == study.ours else {"linewidth": 1.3}
            axes.plot(*zip(*points, strict=True), "o-" if method.ours else "s--", markersize=3.5, label=name, **style)
    axes.set_xticks(places, [level.tick for level in levels])
    axes.set_xlabel(levels[0].axis)
    axes.set_ylabel("median PSNR, dB")
    if axes.lines:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize="small", borderaxespad=0)


def _clearest(exhibits: Sequence[Exhibit], why: str) -> Exhibit | None:
    """The exhibit there for a reason in which ours and the best rival differ most."""
    return max((each for each in exhibits if each.crop.why == why), key=lambda each: abs(each.lead[0]), default=None)


def _shown(exhibit: Exhibit) -> dict[str, Any]:
    """Variables of the template for an exhibit."""
    crop = exhibit.crop
    change = "brightened" if exhibit.stops > 0 else "darkened"
    where = f"{crop.scene.name}, {crop.level.text}, {crop.place}"
    return {
        "title": f"{crop.why[:1].upper()}{crop.why[1:]}",
        "where": where + (f", {change} by {abs(exhibit.stops):.1f} stops" if exhibit.stops else ""),
        "look": _look(exhibit),
        "pictures": [(each.title, each.psnr, embed_picture(each.pixels)) for each in exhibit.pictures],
    }


def _look(exhibit: Exhibit) -> str:
    """What to look at."""
    rgb, luminance, chrominance = exhibit.lead
    if not rgb:
        return ""
    what = "fine detail and noise in brightness" if abs(luminance) >= abs(chrominance) else "colour: its hue, its edges, its noise"
    nearer = "ours" if rgb > 0 else "the rival"
    return f"Look at {what}; {nearer} is nearer to the truth (luminance {luminance:+.1f} dB, chrominance {chrominance:+.1f} dB)."
