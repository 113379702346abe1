"""The page: verdict, crops, a table and three plots, in one HTML file that needs no network; and
the plots of all sets in one SVG.

Crops are small squares of the scenes, after the paper's Fig. 4: where ours and the best rival
differ most, and our worst places.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...shared import DoubleArray, FloatArray, SensorCalibration
from ..io.display import ColourTransform, quantise
from ..io.page import draw_svg, embed_picture, embed_plot, render_page
from ..io.scene import RGB as COLOURS
from ..simulation.protocols import Protocol
from .cameras import CameraPair
from .figures import RGB, Figures, Place, judge
from .metrics import BORDER, PLANES, PSNR_PATCH, TITLES, WINDOW, psnr, window_origins
from .scene_sets import CROP, SceneInfo
from .study import SEED, Study, Team
from .tables import describe, method_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Nobody sees errors below this: crops that differ by many decibels there still look the same.
_INVISIBLE = 0.004**2
# pixels around a crop that are rendered with it and cut off: beyond the reach of every method
_HALO = 96
_BRIGHT, _BRIGHT_SHARE = 0.6, 0.97  # brightness that this quantile of a scene is shown with
_CROP_BRIGHT, _CROP_SHARE = 0.8, 0.9  # the same of a crop, at most
_DARKEST_CROP = 0.01  # scene units: darker pictures are shown dark

AHEAD, BEHIND = "where we gain most", "where we lose most"
WORST = "where our error is largest"
REASONS = AHEAD, BEHIND, WORST
"""Why crops are shown, one for each reason at a noise level."""


class Crop(NamedTuple):
    """A window of a scene at a noise level.

    Parameters
    ----------
    scene, level
        The scene and the noise.
    why
        Reason for which the crop is shown, one of REASONS.
    methods
        Names of the methods that are shown, ours first.
    row, column
        Place of its first pixel in the scene.
    height, width
        Its size, pixels.
    """

    scene: SceneInfo
    level: Protocol
    why: str
    methods: tuple[str, ...]
    row: int
    column: int
    height: int
    width: int

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns in the scene."""
        return slice(self.row, self.row + self.height), slice(self.column, self.column + self.width)


Exhibit = dict[str, Any]
"""The template's variables for a crop, with its pictures: the truth, ours, the best rival if there
is one. Each has a title, its PSNR in RGB, dB, and an address.
"""


def render_crops(figures: Figures, team: Team) -> list[Exhibit]:
    """Return exhibits at the lowest and the highest noise level, rendered by the team; empty
    without one of our renderers, or for scenes in other channels than red, green and blue.
    """
    crops = list(choose_crops(figures)) if figures.study.reading.channels == COLOURS else []
    largest = max((crop.scene.rows * crop.scene.columns for crop in crops), default=0)
    pixels = (WINDOW + 2 * _HALO) ** 2 + largest // 4
    return team.together("crops", partial(render_exhibit, figures.study), crops, pixels)


def choose_crops(figures: Figures) -> Iterator[Crop]:
    """Yield crops by noise level and reason; none of a level overlap."""
    levels = figures.study.levels
    for level in dict.fromkeys((levels[0], levels[-1])):
        scores = {scene: _scores(figures, scene, level) for scene in figures.study.scenes}
        for why in REASONS:
            highest = {scene: of[why].max() for scene, of in scores.items() if why in of}
            scene = max(highest, key=highest.__getitem__, default=None)
            if scene and highest[scene] > 0:
                yield _crop(figures, scene, level, why, scores[scene])


def render_exhibit(study: Study, crop: Crop) -> Exhibit:
    """Render a crop by its methods.

    Raises InputError: a scene or a network is not what was measured; the message names the file.
    """
    scene = study.reading.scene(crop.scene)
    colours = SensorCalibration(camera_to_xyz=scene.camera_to_xyz, neutral=crop.scene.neutral)
    transform = ColourTransform.to_space(colours)
    truth = scene.rgb[crop.window]
    gain = _gain(scene.rgb, truth / np.array(transform.white))
    titles = ("truth", *(study.method(name).title for name in crop.methods))
    pictures = []
    for title, rgb in zip(titles, (truth, *render_crop(study, crop, scene.rgb)), strict=True):
        pixels = quantise(transform.apply(rgb * gain), 8).astype(np.uint8)
        pictures.append((title, psnr(rgb, truth), embed_picture(pixels)))
    where = f"{crop.scene.name}, {crop.level.text}, row {crop.row}, column {crop.column}"
    return {"title": _capitalised(crop.why), "where": where, "pictures": pictures}


def render_crop(study: Study, crop: Crop, truth: FloatArray) -> Iterator[FloatArray]:
    """Render a crop, and a halo around it, from the samples of the whole shots.

    study, crop: the study and the crop. truth: light of the whole scene, float32 (H, W, 3), scene
    units.

    Yields
    ------
    FloatArray
        The crop's picture by each of its methods, float32 (h, w, 3), scene units.
    """
    step = int(np.lcm(2, study.tile.pattern.period))  # keeps the phase of both filter patterns
    rows = _around(crop.row, crop.height, truth.shape[0], step)
    columns = _around(crop.column, crop.width, truth.shape[1], step)
    pattern, window = study.tile.pattern, (rows, columns)
    cameras = CameraPair(crop.level, SEED, truth, pattern, crop.scene.neutral, window)
    top, left = crop.row - rows.start, crop.column - columns.start
    for name in crop.methods:
        yield study.method(name).render(cameras)[top : top + crop.height, left : left + crop.width]


def _scores(figures: Figures, scene: SceneInfo, level: Protocol) -> dict[str, FloatArray]:
    """Return by reason how well each square of a scene shows it; reasons that need missing results
    are left out.
    """
    study = figures.study
    measures = {
        case.method: result
        for case, result in figures.results.items()
        if (case.scene, case.level) == (scene, level) and case.tile in (None, study.tile)
    }
    own, rival = measures.get(study.ours or ""), _rival(figures, scene, level)
    if own is None:
        return {}
    scores = {WORST: np.where(own.errors > _INVISIBLE, own.errors, 0)}
    if rival is not None:
        theirs = np.maximum(measures[rival].errors, _INVISIBLE)
        lead = np.log10(theirs / np.maximum(own.errors, _INVISIBLE))
        scores |= {AHEAD: lead, BEHIND: -lead}
    return scores


def _rival(figures: Figures, scene: SceneInfo, level: Protocol) -> str | None:
    return figures.best(Place(scene.group, level, scene.name), RGB, figures.study.rivals)


def _crop(
    figures: Figures, scene: SceneInfo, level: Protocol, why: str, scores: dict[str, FloatArray]
) -> Crop:
    """Return the square with the highest score for a reason, and remove all that overlap it from
    all scores.
    """
    rows, columns = (np.array(window_origins(size)) for size in (scene.rows, scene.columns))
    row, column = np.unravel_index(int(scores[why].argmax()), scores[why].shape)
    overlaps = np.ix_(abs(rows - rows[row]) < WINDOW, abs(columns - columns[column]) < WINDOW)
    for squares in scores.values():
        squares[overlaps] = 0.0
    size = [min(WINDOW, size - 2 * BORDER) for size in (scene.rows, scene.columns)]
    methods = tuple(filter(None, (figures.study.ours, _rival(figures, scene, level))))
    return Crop(scene, level, why, methods, int(rows[row]), int(columns[column]), *size)


def _around(start: int, length: int, size: int, step: int) -> slice:
    return slice(max(0, start - _HALO) // step * step, min(size, start + length + _HALO))


def _gain(scene: FloatArray, balanced: DoubleArray) -> np.float32:
    """Brightening for display: from the scene's own light, but so that the crop is not all white.

    scene: its light, (H, W, 3).
    balanced: light of the crop, (h, w, 3), 1 = display white.
    """
    brightest = float(np.quantile(scene.max(axis=2)[::4, ::4], _BRIGHT_SHARE))
    crop = float(np.quantile(balanced.max(axis=2), _CROP_SHARE))
    brightened = max(_BRIGHT / max(brightest, _DARKEST_CROP), 1.0)
    return np.float32(min(brightened, _CROP_BRIGHT / max(crop, _DARKEST_CROP)))


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
    return render_page(
        _TEMPLATE,
        title="Is the sparse-colour camera better?",
        summary=describe(figures),
        groups=[_group(figures, name) for name in figures.groups],
        exhibits=exhibits,
        failures=failures,
        facts={"patch": PSNR_PATCH, "border": BORDER, "crop": CROP, "seed": SEED},
        conditions=study.levels[0].conditions,
        program=program,
    )


def _group(figures: Figures, name: str) -> dict[str, Any]:
    """Return the template's variables for a set of scenes."""
    plots = [embed_plot(partial(draw_noise, figures, name, plane), 4.6, 3.6) for plane in range(3)]
    return {
        "name": _capitalised(name),
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
            row[0].set_title(f"{_capitalised(name)}: {TITLES[0]}", loc="left")
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
        low, median, high = np.array([[row.get(q, np.nan) for row in values] for q in quantiles])
        places, bars = np.arange(len(levels)) + offset, (median - low, high - median)
        line: Any = {"linewidth": 2.4 if name == study.ours else 1.3, "color": colour}
        line["fmt"] = "o-" if study.method(name).ours else "s--"
        axes.errorbar(places, median, bars, **line, elinewidth=1, capsize=2, markersize=3.5)
    axes.set_title(TITLES[plane], loc="left")
    axes.set_xticks(range(len(levels)), [f"{level.level:g}" for level in levels])
    axes.set_xlabel(levels[0].unit)
    axes.set_ylabel("PSNR, dB: median and quartiles")


def _capitalised(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"
