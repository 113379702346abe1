"""The gallery, after the paper's Fig. 4: small squares of the scenes where the methods differ most, and where we are worst."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from math import lcm, log2

import numpy as np

from shared import Mosaic, SensorCalibration
from shared.arrays import ByteArray, FloatArray
from shared.display import ColourTransform
from tools.pictures.samples import quantise

from ..figures import Figures
from ..measures import WINDOW, Measures, window_origins
from ..methods import choose, denoise, methods, render_bayer, render_sparse
from ..metrics import BORDER
from ..protocol import BayerShot
from ..scene_sets import SceneInfo
from ..study import Study
from ..team import Team

# Errors below this are seen by nobody: a square may differ by many decibels there, and still be the same picture.
_INVISIBLE = 0.004**2
_HALO = 96  # pixels around a square that are rendered with it and cut off: beyond the reach of every method
_PER_KIND = 3
_RIVALS = 4
_BRIGHT, _BRIGHT_SHARE = 0.6, 0.97  # so bright is this quantile of a scene shown
_MOST_STOPS = 6.0


@dataclass(frozen=True)
class Place:
    """A square of a scene at a level, and why it was chosen."""

    scene: SceneInfo
    level: float
    row: int
    column: int
    height: int
    width: int
    why: str


@dataclass(frozen=True, eq=False)
class Picture:
    """One rendering of a place: method ("" is the truth), sRGB uint8 (h, w, 3), and its PSNR there, dB (None of the truth)."""

    method: str
    pixels: ByteArray
    psnr: float | None


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A place with its pictures, the truth first; stops: by how much the scene is brightened to be seen."""

    place: Place
    pictures: tuple[Picture, ...]
    stops: float


WHY_AHEAD, WHY_BEHIND, WHY_WORST = "where we gain most", "where we lose most", "where our error is largest"


def gallery(figures: Figures, team: Team) -> list[Exhibit]:
    """Exhibits at the lowest and the highest level, rendered by the team. Empty when there is nothing of ours or no rival."""
    places = list(choose_places(figures))
    if not places:
        return []
    pixels = (WINDOW + 2 * _HALO) ** 2 + max(place.scene.rows * place.scene.columns for place in places) // 4
    shown = [(place, _shown(figures, place)) for place in places]
    return team.together("gallery", partial(exhibit, figures.study), shown, pixels)


def choose_places(figures: Figures) -> Iterator[Place]:
    """Up to three squares per kind and level, of different scenes where there are so many."""
    levels = figures.study.levels
    for level in dict.fromkeys((levels[0], levels[-1])):
        taken: list[Place] = []
        for why in (WHY_AHEAD, WHY_BEHIND, WHY_WORST):
            found = sorted(_candidates(figures, level, why, taken), key=lambda candidate: -candidate[0])
            for score, place in found[:_PER_KIND]:
                if score > 0:
                    taken.append(place)
                    yield place


def exhibit(study: Study, shown: tuple[Place, tuple[str, ...]]) -> Exhibit:
    """Render a place by the methods named."""
    place, names = shown
    scene = study.reading.scene(place.scene.source)
    transform = ColourTransform.to_space(SensorCalibration(camera_to_xyz=scene.camera_to_xyz, neutral=place.scene.neutral))
    stops = _stops(scene.rgb)
    truth = scene.rgb[_inner(place)]
    pictures = [Picture("", _display(truth, transform, stops), None)]
    shots = Shots(study, place, scene.rgb)
    for name in names:
        rendered = shots.render(name)
        square = float(np.square(rendered.astype(np.float64) - truth).mean())
        pictures.append(Picture(name, _display(rendered, transform, stops), -10 * float(np.log10(max(square, 1e-20)))))
    return Exhibit(place, tuple(pictures), stops)


class Shots:
    """What both cameras measured of a place and its surroundings: the same samples as in the whole frame, each made once."""

    def __init__(self, study: Study, place: Place, truth: FloatArray) -> None:
        self._study, self._place, self._truth = study, place, truth
        step = lcm(2, study.period)  # the cut keeps the phase of both filter patterns
        self._rows = _around(place.row, place.height, truth.shape[0], step)
        self._columns = _around(place.column, place.width, truth.shape[1], step)

    def render(self, name: str) -> FloatArray:
        """The picture of the place by a method, float32 (height, width, 3), scene units."""
        (method,) = choose([name])
        if method.ours:
            picture = render_sparse(method, self._sparse, self._study.protocol.gain(self._place.level))
        else:
            denoised = self._denoised if method.denoised else None
            picture = render_bayer(method, self._bayer, self._place.scene.neutral, denoised)
        top, left = self._place.row - self._rows.start, self._place.column - self._columns.start
        return picture[top : top + self._place.height, left : left + self._place.width]

    @cached_property
    def _sparse(self) -> Mosaic:
        shot = self._study.protocol.sparse_shot(self._truth, self._place.level, self._study.period)
        return Mosaic(shot.samples[self._rows, self._columns], shot.pattern, shot.calibration)

    @cached_property
    def _bayer(self) -> BayerShot:
        shot = self._study.protocol.bayer_shot(self._truth, self._place.level)
        return BayerShot(shot.samples[self._rows, self._columns], shot.shot, shot.read, shot.order)

    @cached_property
    def _denoised(self) -> FloatArray:
        return denoise(self._bayer)


def _candidates(figures: Figures, level: float, why: str, taken: list[Place]) -> Iterator[tuple[float, Place]]:
    """The best square of each scene, with how much it shows."""
    for scene in figures.study.scenes:
        errors = {name: measures.errors for name, measures in _of(figures, scene, level)}
        own = figures.ours
        rival = figures.best_rival(lambda name, at=scene.name: figures.of_scene(at, level, name))  # type: ignore[misc]
        if own is None or own not in errors or rival is None:
            continue
        ours, theirs = (np.maximum(errors[name], _INVISIBLE) for name in (own, rival.method))
        scores = {
            WHY_AHEAD: np.log10(theirs / ours),
            WHY_BEHIND: np.log10(ours / theirs),
            WHY_WORST: np.where(errors[own] > _INVISIBLE, ours, 0.0),
        }[why].copy()
        origins = [window_origins(size) for size in (scene.rows, scene.columns)]
        for row, column in np.argwhere(scores > 0).tolist():
            if any(_overlap(place, scene, origins[0][row], origins[1][column]) for place in taken):
                scores[row, column] = 0.0
        row, column = (int(each) for each in np.unravel_index(int(scores.argmax()), scores.shape))
        height, width = (min(WINDOW, size - 2 * BORDER) for size in (scene.rows, scene.columns))
        yield float(scores[row, column]), Place(scene, level, origins[0][row], origins[1][column], height, width, why)


def _of(figures: Figures, scene: SceneInfo, level: float) -> Iterable[tuple[str, Measures]]:
    period = figures.study.period
    for cell, measures in figures.results.items():
        if cell.scene == scene and cell.level == level and cell.period in (0, period):
            yield cell.method, measures


def _shown(figures: Figures, place: Place) -> tuple[str, ...]:
    """Ours, the paper's baseline, and the rivals that are best on this scene."""
    scored = [
        (figure.quality.median[0], name)
        for name in figures.rivals
        if (figure := figures.of_scene(place.scene.name, place.level, name)) is not None
    ]
    best = [name for _, name in sorted(scored, reverse=True)][:_RIVALS]
    if "dlmmse" in figures.rivals and "dlmmse" not in best:
        best = [*best[: _RIVALS - 1], "dlmmse"]
    ours = [name for name in figures.study.methods if methods()[name].ours]
    ours.sort(key=lambda name: name != figures.ours)
    return (*dict.fromkeys(ours), *best)


def _overlap(place: Place, scene: SceneInfo, row: int, column: int) -> bool:
    return place.scene == scene and abs(place.row - row) < WINDOW and abs(place.column - column) < WINDOW


def _around(start: int, length: int, size: int, step: int) -> slice:
    return slice(max(0, start - _HALO) // step * step, min(size, start + length + _HALO))


def _inner(place: Place) -> tuple[slice, slice]:
    return slice(place.row, place.row + place.height), slice(place.column, place.column + place.width)


def _stops(rgb: FloatArray) -> float:
    """Brightening for display, by the scene's own light."""
    bright = float(np.quantile(rgb.max(axis=2)[::4, ::4], _BRIGHT_SHARE))
    return min(max(log2(_BRIGHT / bright), 0.0), _MOST_STOPS) if bright > 0 else 0.0


def _display(rgb: FloatArray, transform: ColourTransform, stops: float) -> ByteArray:
    return quantise(transform.apply(rgb, stops), 8).astype(np.uint8)
