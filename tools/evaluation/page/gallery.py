"""The gallery, after the paper's Fig. 4: small crops where the methods differ most, and where our error is largest."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import lcm, log2

import numpy as np

from shared import SensorCalibration
from shared.arrays import ByteArray, FloatArray
from shared.display import ColourTransform
from tools.camera.protocols import Protocol
from tools.pictures.samples import quantise
from tools.scenes.scene import RGB as RGB_CHANNELS

from ..cameras import CameraPair
from ..criteria import RGB
from ..figures import Figures
from ..measures import WINDOW, window_origins
from ..methods import methods
from ..metrics import BORDER, psnr
from ..scene_sets import SceneInfo
from ..study import Study, can_photograph
from ..team import Team
from ..tiles import Tile

# Nobody sees errors below this: crops that differ by many decibels there still look the same.
_INVISIBLE = 0.004**2
_HALO = 96  # pixels around a crop that are rendered with it and cut off: beyond the reach of every method
_PER_KIND = 3
_RIVALS = 4
_BRIGHT, _BRIGHT_SHARE = 0.6, 0.97  # brightness that this quantile of a scene is shown with
_MOST_STOPS = 6.0

WHY_AHEAD, WHY_BEHIND, WHY_WORST = "where we gain most", "where we lose most", "where our error is largest"
WHY_HUE = "where most of our hues are wrong"
LEARNED, UNLEARNED = "best", "unlearned"
WHY_LEARNED = "where learning changes most, for better or worse"
WHY_PATTERNS = "where the patterns differ most"


@dataclass(frozen=True)
class Crop:
    """A part of a scene at a noise level, and why it was chosen (WHY_...).

    row, column: of its first pixel.
    height, width: pixels.
    """

    scene: SceneInfo
    level: Protocol
    row: int
    column: int
    height: int
    width: int
    why: str

    @property
    def part(self) -> tuple[slice, slice]:
        """Rows and columns in the scene."""
        return slice(self.row, self.row + self.height), slice(self.column, self.column + self.width)


@dataclass(frozen=True, eq=False)
class Rendered:
    """One rendering of a crop.

    method: name; "" for the truth.
    pixels: sRGB, uint8 (h, w, 3).
    psnr: of the crop, dB; None for the truth.
    pattern: name, where patterns are compared; otherwise "".
    """

    method: str
    pixels: ByteArray
    psnr: float | None
    pattern: str = ""


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A crop with its pictures, the truth first; stops: brightening for display."""

    crop: Crop
    pictures: tuple[Rendered, ...]
    stops: float


def render_gallery(figures: Figures, team: Team) -> list[Exhibit]:
    """Exhibits at the lowest and the highest level, rendered by the team.

    Empty without a method of ours, and without a rival or another pattern.
    """
    crops = list(choose_crops(figures))
    if not crops:
        return []
    pixels = (WINDOW + 2 * _HALO) ** 2 + max(crop.scene.rows * crop.scene.columns for crop in crops) // 4
    shown = [(crop, _shown(figures, crop)) for crop in crops]
    return team.together("gallery", partial(render_exhibit, figures.study), shown, pixels)


def choose_crops(figures: Figures) -> Iterator[Crop]:
    """Up to three crops per reason and level, each from another scene."""
    levels = figures.study.levels
    for level in dict.fromkeys((levels[0], levels[-1])):
        taken: list[Crop] = []
        for why in (WHY_AHEAD, WHY_BEHIND, WHY_WORST, WHY_HUE, WHY_LEARNED, WHY_PATTERNS):
            others = [crop for crop in taken if WHY_PATTERNS not in (why, crop.why)]  # shown in a section of their own
            found = sorted(_candidates(figures, level, why, others), key=lambda candidate: -candidate[0])
            for score, crop in found[:_PER_KIND]:
                if score > 0:
                    taken.append(crop)
                    yield crop


def render_exhibit(study: Study, shown: tuple[Crop, tuple[str, ...]]) -> Exhibit:
    """Render a crop by the methods named, with each pattern if the crop is there for them."""
    crop, names = shown
    scene = study.reading.scene(crop.scene.source)
    transform = ColourTransform.to_space(SensorCalibration(camera_to_xyz=scene.camera_to_xyz, neutral=crop.scene.neutral))
    stops = _stops(scene.rgb)
    truth = scene.rgb[crop.part]
    pictures = [Rendered("", _display(truth, transform, stops), None)]
    several = crop.why == WHY_PATTERNS
    tiles = [tile for tile in study.tiles if can_photograph(tile, scene.channels)] if several else [study.tile]
    for tile in tiles:
        for name, rendered in render_crop(study, crop, scene.rgb, names, tile):
            label = tile.name if several else ""
            pictures.append(Rendered(name, _display(rendered, transform, stops), psnr(rendered, truth), label))
    return Exhibit(crop, tuple(pictures), stops)


def render_crop(
    study: Study, crop: Crop, truth: FloatArray, names: Iterable[str], tile: Tile | None = None
) -> Iterator[tuple[str, FloatArray]]:
    """(method, its picture of a crop, float32 (h, w, 3), scene units): from the samples of the whole frame's shots.

    Only the crop and its surroundings are rendered.

    truth: light of the whole scene, (H, W, 3), scene units.
    names: of the methods.
    tile: pattern of the sparse-colour camera, by default the study's.
    """
    pattern = (tile or study.tile).pattern
    step = lcm(2, pattern.period)  # keeps the phase of both filter patterns
    rows = _around(crop.row, crop.height, truth.shape[0], step)
    columns = _around(crop.column, crop.width, truth.shape[1], step)
    cameras = CameraPair(crop.level, study.seed, truth, pattern, crop.scene.neutral, (rows, columns))
    top, left = crop.row - rows.start, crop.column - columns.start
    for name in names:
        yield name, methods()[name].render(cameras)[top : top + crop.height, left : left + crop.width]


def _candidates(figures: Figures, level: Protocol, why: str, taken: list[Crop]) -> Iterator[tuple[float, Crop]]:
    """The best crop of each scene, with its score."""
    for scene in figures.study.scenes:
        results = {
            cell.method: measures
            for cell, measures in figures.results.items()
            if cell.scene == scene and cell.level == level and cell.tile in (None, figures.study.tile)
        }
        own, rival = figures.study.ours, figures.at_scene(scene.name, level).best(figures.study.rivals)
        if own is None or own not in results or scene.channels != RGB_CHANNELS or (rival is None and why != WHY_PATTERNS):
            continue
        errors = results[own].errors
        ours, theirs = (np.maximum(results[name].errors, _INVISIBLE) for name in (own, rival or own))
        plain = np.maximum(results[UNLEARNED].errors, _INVISIBLE) if UNLEARNED in results else ours
        by_pattern = [
            np.maximum(measures.errors, _INVISIBLE)
            for cell, measures in figures.results.items()
            if cell.scene == scene and cell.level == level and cell.method == own
        ]
        scores = {
            WHY_AHEAD: np.log10(theirs / ours),
            WHY_BEHIND: np.log10(ours / theirs),
            WHY_WORST: np.where(errors > _INVISIBLE, ours, 0.0),
            WHY_HUE: results[own].hues,
            WHY_LEARNED: np.abs(np.log10(plain / ours)) * (own == LEARNED),
            WHY_PATTERNS: np.log10(np.max(by_pattern, axis=0) / np.min(by_pattern, axis=0)),
        }[why].copy()
        origins = [window_origins(size) for size in (scene.rows, scene.columns)]
        for row, column in np.argwhere(scores > 0).tolist():
            if any(_overlap(crop, scene, origins[0][row], origins[1][column]) for crop in taken):
                scores[row, column] = 0.0
        row, column = (int(each) for each in np.unravel_index(int(scores.argmax()), scores.shape))
        height, width = (min(WINDOW, size - 2 * BORDER) for size in (scene.rows, scene.columns))
        yield float(scores[row, column]), Crop(scene, level, origins[0][row], origins[1][column], height, width, why)


def _shown(figures: Figures, crop: Crop) -> tuple[str, ...]:
    """Methods shown: ours with the best first, the paper's rival, and the best rivals on this scene; of patterns our best only."""
    if crop.why == WHY_PATTERNS:
        return tuple(filter(None, [figures.study.ours]))
    scored = [
        (figure.quality.median[RGB], name)
        for name in figures.study.rivals
        if (figure := figures.of_scene(crop.scene.name, crop.level, name)) is not None
    ]
    best = [name for _, name in sorted(scored, reverse=True)][:_RIVALS]
    if "dlmmse" in figures.study.rivals and "dlmmse" not in best:
        best = [*best[: _RIVALS - 1], "dlmmse"]
    ours = [name for name in figures.study.methods if methods()[name].ours]
    return (*sorted(ours, key=lambda name: name != figures.study.ours), *best)


def _overlap(crop: Crop, scene: SceneInfo, row: int, column: int) -> bool:
    return crop.scene == scene and abs(crop.row - row) < WINDOW and abs(crop.column - column) < WINDOW


def _around(start: int, length: int, size: int, step: int) -> slice:
    return slice(max(0, start - _HALO) // step * step, min(size, start + length + _HALO))


def _stops(rgb: FloatArray) -> float:
    """Brightening for display, from the scene's own light."""
    bright = float(np.quantile(rgb.max(axis=2)[::4, ::4], _BRIGHT_SHARE))
    return min(max(log2(_BRIGHT / bright), 0.0), _MOST_STOPS) if bright > 0 else 0.0


def _display(rgb: FloatArray, transform: ColourTransform, stops: float) -> ByteArray:
    return quantise(transform.apply(rgb, stops), 8).astype(np.uint8)
