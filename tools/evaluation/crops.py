"""Small squares of the scenes, after the paper's Fig. 4: where ours and the best rival differ most, and our worst places."""

from collections.abc import Iterator, Sequence
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
from tools.simulation.protocols import Protocol

from .cameras import CameraPair
from .figures import RGB, Figures
from .measures import WINDOW, window_origins
from .metrics import BORDER, whole_psnr
from .scene_sets import SceneInfo
from .study import Study
from .team import Team

# Nobody sees errors below this: crops that differ by many decibels there still look the same.
_INVISIBLE = 0.004**2
_HALO = 96  # pixels around a crop that are rendered with it and cut off: beyond the reach of every method
_WORST = 3  # crops of the worst places at each level, by each measure
_BRIGHT, _BRIGHT_SHARE = 0.6, 0.97  # brightness that this quantile of a scene is shown with
_MOST_STOPS = 6.0
_CROP_BRIGHT, _CROP_SHARE = 0.8, 0.9  # brightness that this quantile of a crop is shown with at most

AHEAD, BEHIND = "where we gain most", "where we lose most"
WORST, WRONG_HUE = "where our error is largest", "where most hues are wrong"
REASONS = {AHEAD: 1, BEHIND: 1, WORST: _WORST, WRONG_HUE: _WORST}
"""Why crops are shown, and how many for each reason at a noise level."""


@dataclass(frozen=True)
class Crop:
    """A part of a scene at a noise level.

    why: one of REASONS.
    methods: shown, ours first.
    row, column: of its first pixel.
    height, width: pixels.
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

    title: of the method, or "truth".
    pixels: sRGB, uint8 (h, w, 3).
    psnr: of the crop in RGB, luminance and chrominance, dB; None for the truth.
    """

    title: str
    pixels: ByteArray
    psnr: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A crop with its pictures: the truth, ours, the best rival if there is one.

    stops: brightening for display; negative ones darken.
    """

    crop: Crop
    pictures: tuple[Rendered, ...]
    stops: float

    @property
    def lead(self) -> tuple[float, float, float]:
        """How much nearer to the truth ours is than the rival, in RGB, luminance and chrominance, dB; zeros without a rival."""
        if len(self.pictures) < 3 or self.pictures[1].psnr is None or self.pictures[2].psnr is None:
            return 0.0, 0.0, 0.0
        rgb, luminance, chrominance = np.subtract(self.pictures[1].psnr, self.pictures[2].psnr).tolist()
        return rgb, luminance, chrominance


def render_crops(figures: Figures, team: Team) -> list[Exhibit]:
    """Exhibits at the lowest and the highest level, rendered by the team; empty without a method of ours."""
    crops = list(choose_crops(figures))
    if not crops:
        return []
    pixels = (WINDOW + 2 * _HALO) ** 2 + max(crop.scene.rows * crop.scene.columns for crop in crops) // 4
    return team.together("crops", partial(render_exhibit, figures.study), crops, pixels)


def choose_crops(figures: Figures) -> Iterator[Crop]:
    """Crops by reason and level, each reason's from different scenes, none over another of its level."""
    levels = figures.study.levels
    for level in dict.fromkeys((levels[0], levels[-1])):
        scores = [(scene, *_scores(figures, scene, level)) for scene in figures.study.scenes]
        taken: list[Crop] = []
        for why, most in REASONS.items():
            found = [_best_crop(scene, level, why, shown, known[why], taken) for scene, shown, known in scores if why in known]
            for score, crop in sorted(found, key=lambda each: -each[0])[:most]:
                if score > 0:
                    taken.append(crop)
                    yield crop


def render_exhibit(study: Study, crop: Crop) -> Exhibit:
    """Render a crop by its methods.

    Raises InputError, naming the file, if a scene or a network is not what was measured.
    """
    try:
        scene = study.reading.scene(crop.scene.source, crop.scene.digest)
    except InputError as error:
        raise InputError(f"{crop.scene.source}: {error}") from None
    transform = ColourTransform.to_space(SensorCalibration(camera_to_xyz=scene.camera_to_xyz, neutral=crop.scene.neutral))
    truth = scene.rgb[crop.part]
    stops = min(_stops(scene.rgb), _most_stops((truth / np.array(transform.white)).astype(np.float32)))

    def displayed(rgb: FloatArray) -> ByteArray:
        # A gain of the light, because a negative exposure leaves white what is burnt out, and it may differ.
        return quantise(transform.apply(rgb * np.float32(2.0**stops)), 8).astype(np.uint8)

    pictures = [Rendered("truth", displayed(truth))]
    for name, picture in zip(crop.methods, render_crop(study, crop, scene.rgb), strict=True):
        pictures.append(Rendered(study.method(name).title, displayed(picture), whole_psnr(picture, truth)))
    return Exhibit(crop, tuple(pictures), stops)


def render_crop(study: Study, crop: Crop, truth: FloatArray) -> Iterator[FloatArray]:
    """The pictures of a crop, float32 (h, w, 3), scene units, by its methods: from the samples of the whole shots.

    Only the crop and its surroundings are rendered.

    truth: light of the whole scene, (H, W, 3), scene units.
    """
    step = lcm(2, study.tile.pattern.period)  # keeps the phase of both filter patterns
    rows = _around(crop.row, crop.height, truth.shape[0], step)
    columns = _around(crop.column, crop.width, truth.shape[1], step)
    cameras = CameraPair(crop.level, study.seed, truth, study.tile.pattern, crop.scene.neutral, (rows, columns))
    top, left = crop.row - rows.start, crop.column - columns.start
    for name in crop.methods:
        yield study.method(name).render(cameras)[top : top + crop.height, left : left + crop.width]


def _scores(figures: Figures, scene: SceneInfo, level: Protocol) -> tuple[tuple[str, ...], dict[str, FloatArray]]:
    """Ours and the best rival of a scene; and by reason how well each square shows it, without what was not measured."""
    study = figures.study
    here = [(cell, each) for cell, each in figures.results.items() if (cell.scene, cell.level) == (scene, level)]
    found = {cell.method: each for cell, each in here if cell.tile in (None, study.tile)}
    own = found.get(study.ours or "")
    if study.ours is None or own is None or scene.channels != RGB_CHANNELS:
        return (), {}
    scores = {WORST: np.where(own.errors > _INVISIBLE, own.errors, 0), WRONG_HUE: own.hues}
    rival = figures.best(scene.group, level, RGB, study.rivals, scene.name)
    if rival is None:
        return (study.ours,), scores
    lead = np.log10(np.maximum(found[rival].errors, _INVISIBLE) / np.maximum(own.errors, _INVISIBLE))
    return (study.ours, rival), {AHEAD: lead, BEHIND: -lead, **scores}


def _best_crop(
    scene: SceneInfo, level: Protocol, why: str, shown: tuple[str, ...], scores: FloatArray, taken: Sequence[Crop]
) -> tuple[float, Crop]:
    """The square of a scene with the highest score that overlaps none of those taken, and its score."""
    rows, columns = (window_origins(size) for size in (scene.rows, scene.columns))
    free = scores.copy()
    for crop in taken:
        if crop.scene == scene:
            near = (np.abs(np.subtract(each, at)) < WINDOW for each, at in ((rows, crop.row), (columns, crop.column)))
            free[np.logical_and.outer(*near)] = 0.0
    row, column = (int(each) for each in np.unravel_index(int(free.argmax()), free.shape))
    height, width = (min(WINDOW, size - 2 * BORDER) for size in (scene.rows, scene.columns))
    return float(free[row, column]), Crop(scene, level, why, shown, rows[row], columns[column], height, width)


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
