"""The gallery, after the paper's Fig. 4: small crops where methods differ most or our error is largest."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import lcm, log2

import numpy as np

from shared import SensorCalibration
from shared.arrays import ByteArray, FloatArray
from shared.errors import InputError
from tools.io.display import ColourTransform
from tools.io.samples import quantise
from tools.io.scene import RGB as RGB_CHANNELS
from tools.simulation.noise import Protocol

from ..cameras import CameraPair
from ..figures import RGB, Figures
from ..measures import WINDOW, window_origins
from ..methods import method_of, methods
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
_CROP_BRIGHT, _CROP_SHARE = 0.8, 0.9  # brightness that this quantile of a crop is shown with at most

WHY_AHEAD, WHY_BEHIND, WHY_WORST = "where we gain most", "where we lose most", "where our error is largest"
WHY_HUE = "where most of our hues are wrong"
LEARNED, UNLEARNED = "best", "unlearned"
WHY_LEARNED = "where learning changes most, for better or worse"
WHY_PATTERNS = "where the patterns differ most"
REASONS = (WHY_AHEAD, WHY_BEHIND, WHY_WORST, WHY_HUE, WHY_LEARNED, WHY_PATTERNS)


@dataclass(frozen=True)
class Crop:
    """A part of a scene at a noise level, and why it was chosen: one of REASONS, or the name that somebody gave it.

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

    @property
    def place(self) -> str:
        """Where it begins in the photograph, for people."""
        row, column = self.scene.origin
        return f"row {row + self.row}, column {column + self.column}"


@dataclass(frozen=True, eq=False)
class Rendered:
    """One rendering of a crop.

    name: of the method, of the pattern where patterns are compared, or "truth".
    pixels: sRGB, uint8 (h, w, 3).
    psnr: of the crop, dB; None for the truth.
    ours: whether it is to be told apart as ours; where patterns are compared, none is.
    """

    name: str
    pixels: ByteArray
    psnr: float | None = None
    ours: bool = False

    @property
    def title(self) -> str:
        """The name, with the PSNR if it has one."""
        return self.name if self.psnr is None else f"{self.name}, {self.psnr:.1f} dB"


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A crop with its pictures, the truth first.

    stops: brightening for display; negative ones darken.
    shown: places of the pictures on the left and on the right at first: best rival and our best, or worst and best pattern.
    """

    crop: Crop
    pictures: tuple[Rendered, ...]
    stops: float
    shown: tuple[int, int]


def render_gallery(figures: Figures, team: Team) -> list[Exhibit]:
    """Exhibits at the lowest and the highest level, rendered by the team.

    Empty without a method of ours, and without a rival or another pattern.
    """
    shown = [(crop, _shown(figures, crop)) for crop in choose_crops(figures)]
    if not shown:
        return []
    pixels = (WINDOW + 2 * _HALO) ** 2 + max(crop.scene.rows * crop.scene.columns for crop, _ in shown) // 4
    return team.together("gallery", partial(render_exhibit, figures.study), shown, pixels)


def choose_crops(figures: Figures) -> Iterator[Crop]:
    """Up to three crops per reason and level, each from another scene."""
    levels = figures.study.levels
    for level in dict.fromkeys((levels[0], levels[-1])):
        scores = [(scene, _scores(figures, scene, level)) for scene in figures.study.scenes]
        taken: list[Crop] = []
        for why in REASONS:
            others = [crop for crop in taken if WHY_PATTERNS not in (why, crop.why)]  # shown in a section of their own
            found = [_best_crop(scene, level, why, known[why].copy(), others) for scene, known in scores if why in known]
            for score, crop in sorted(found, key=lambda each: -each[0])[:_PER_KIND]:
                if score > 0:
                    taken.append(crop)
                    yield crop


def render_exhibit(study: Study, shown: tuple[Crop, tuple[str, ...]]) -> Exhibit:
    """Render a crop by the methods named, ours first, with each pattern if the crop is there for them.

    Raises InputError, naming the file, if a scene or a network is not what was measured.
    """
    crop, names = shown
    try:
        scene = study.reading.scene(crop.scene.source, crop.scene.digest)
    except InputError as error:
        raise InputError(f"{crop.scene.source}: {error}") from None
    transform = ColourTransform.to_space(SensorCalibration(camera_to_xyz=scene.camera_to_xyz, neutral=crop.scene.neutral))
    truth, several = scene.rgb[crop.part], crop.why == WHY_PATTERNS
    stops = min(_stops(scene.rgb), _most_stops((truth / np.array(transform.white)).astype(np.float32)))

    def displayed(rgb: FloatArray) -> ByteArray:
        # A gain of the light, because a negative exposure leaves white what is burnt out, and it may differ.
        return quantise(transform.apply(rgb * np.float32(2.0**stops)), 8).astype(np.uint8)

    pictures = [Rendered("truth", displayed(truth))]
    tiles = [tile for tile in study.tiles if can_photograph(tile, scene.channels)] if several else [study.tile]
    for tile in tiles:
        for name, picture in render_crop(study, crop, scene.rgb, names, tile):
            method, ours = methods()[name], methods()[name].ours
            title = tile.name if several else method.title if ours else method.short
            pictures.append(Rendered(title, displayed(picture), psnr(picture, truth), ours and not several))
    by_psnr = sorted(range(1, len(pictures)), key=lambda place: pictures[place].psnr or 0.0)
    rival = next((place for place, picture in enumerate(pictures) if place and not picture.ours), 0)
    return Exhibit(crop, tuple(pictures), stops, (by_psnr[0], by_psnr[-1]) if several else (rival, 1))


def render_crop(
    study: Study, crop: Crop, truth: FloatArray, names: Iterable[str], tile: Tile | None = None
) -> Iterator[tuple[str, FloatArray]]:
    """(method, its picture of a crop, float32 (h, w, 3), scene units): from the samples of the whole shots.

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
        yield name, method_of(name, study.networks).render(cameras)[top : top + crop.height, left : left + crop.width]


def _scores(figures: Figures, scene: SceneInfo, level: Protocol) -> dict[str, FloatArray]:
    """How well each square of a scene shows why it is shown, by reason; without those for which results are missing."""
    study, group = figures.study, figures.of(scene)
    found = {
        (cell.method, cell.tile): measures
        for cell, measures in figures.results.items()
        if (cell.scene, cell.level) == (scene, level)
    }
    own = found.get((study.ours or "", study.tile))
    if own is None or group is None or scene.channels != RGB_CHANNELS:
        return {}
    errors = {key: np.maximum(measures.errors, _INVISIBLE) for key, measures in found.items()}
    ours, rival = errors[study.ours or "", study.tile], group.best(level, RGB, study.rivals, scene.name)
    patterns = [each for (method, _), each in errors.items() if method == study.ours]
    scores: dict[str, FloatArray] = {WHY_PATTERNS: np.log10(np.max(patterns, axis=0) / np.min(patterns, axis=0))}
    if rival is not None:
        lead = np.log10(errors[rival, None] / ours)
        scores |= {WHY_AHEAD: lead, WHY_BEHIND: -lead, WHY_WORST: np.where(own.errors > _INVISIBLE, ours, 0), WHY_HUE: own.hues}
        if study.ours == LEARNED and (UNLEARNED, study.tile) in errors:
            scores[WHY_LEARNED] = np.abs(np.log10(errors[UNLEARNED, study.tile] / ours))
    return scores


def _best_crop(scene: SceneInfo, level: Protocol, why: str, scores: FloatArray, taken: list[Crop]) -> tuple[float, Crop]:
    """The square of a scene with the highest score that overlaps none of those taken, and its score; `scores` is used up."""
    rows, columns = (window_origins(size) for size in (scene.rows, scene.columns))
    for crop in taken:
        if crop.scene == scene:
            near = (np.abs(np.subtract(each, at)) < WINDOW for each, at in ((rows, crop.row), (columns, crop.column)))
            scores[np.logical_and.outer(*near)] = 0.0
    row, column = (int(each) for each in np.unravel_index(int(scores.argmax()), scores.shape))
    height, width = (min(WINDOW, size - 2 * BORDER) for size in (scene.rows, scene.columns))
    return float(scores[row, column]), Crop(scene, level, rows[row], columns[column], height, width, why)


def _shown(figures: Figures, crop: Crop) -> tuple[str, ...]:
    """Methods shown: ours with the best first, the paper's rival, and the best rivals on this scene; of patterns our best only."""
    study, group = figures.study, figures.of(crop.scene)
    if crop.why == WHY_PATTERNS or group is None:
        return tuple(filter(None, [study.ours]))
    scored = [(RGB.of(figure), name) for name in study.rivals if (figure := group.figure(crop.level, name, crop.scene.name))]
    best = [name for _, name in sorted(scored, reverse=True)][:_RIVALS]
    if "dlmmse" in study.rivals and "dlmmse" not in best:
        best = [*best[: _RIVALS - 1], "dlmmse"]
    ours = [name for name in study.methods if methods()[name].ours]
    return (*sorted(ours, key=lambda name: name != study.ours), *best)


def _around(start: int, length: int, size: int, step: int) -> slice:
    return slice(max(0, start - _HALO) // step * step, min(size, start + length + _HALO))


def _stops(rgb: FloatArray) -> float:
    """Brightening for display, from the scene's own light."""
    bright = float(np.quantile(rgb.max(axis=2)[::4, ::4], _BRIGHT_SHARE))
    return min(max(log2(_BRIGHT / bright), 0.0), _MOST_STOPS) if bright > 0 else 0.0


def _most_stops(balanced: FloatArray) -> float:
    """Brightening with which a crop is not all white. balanced: its light (h, w, C), 1 = display white."""
    bright = float(np.quantile(balanced.max(axis=2), _CROP_SHARE))
    return max(log2(_CROP_BRIGHT / bright), -_MOST_STOPS) if bright > 0 else _MOST_STOPS
