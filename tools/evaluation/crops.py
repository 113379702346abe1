"""Small squares of the scenes, after the paper's Fig. 4: where ours and the best rival differ most,
and our worst places.
"""

from collections.abc import Iterator
from functools import partial
from math import lcm
from typing import NamedTuple

import numpy as np

from ...shared import SensorCalibration
from ...shared.arrays import ByteArray, DoubleArray, FloatArray
from ..io.display import ColourTransform
from ..io.samples import quantise
from ..io.scene import RGB as COLOURS
from ..simulation.protocols import Protocol
from .cameras import CameraPair
from .figures import RGB, Figures, Place
from .measures import WINDOW, window_origins
from .metrics import BORDER, psnr
from .scene_sets import SceneInfo
from .study import Study
from .team import Team

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


class Rendered(NamedTuple):
    """One rendering of a crop.

    Parameters
    ----------
    title
        Title of the method, or "truth".
    pixels
        The picture for a screen: sRGB, uint8 (h, w, 3).
    psnr
        PSNR of the crop in RGB, dB.
    """

    title: str
    pixels: ByteArray
    psnr: float


Exhibit = tuple[Crop, tuple[Rendered, ...]]
"""A crop with its pictures: the truth, ours, the best rival if there is one."""


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

    def display(rgb: FloatArray) -> ByteArray:
        return quantise(transform.apply(rgb * gain), 8).astype(np.uint8)

    titles = ("truth", *(study.method(name).title for name in crop.methods))
    pictures = zip(titles, (truth, *render_crop(study, crop, scene.rgb)), strict=True)
    return crop, tuple(Rendered(name, display(rgb), psnr(rgb, truth)) for name, rgb in pictures)


def render_crop(study: Study, crop: Crop, truth: FloatArray) -> Iterator[FloatArray]:
    """Render a crop, and a halo around it, from the samples of the whole shots.

    study, crop: the study and the crop. truth: light of the whole scene, float32 (H, W, 3), scene
    units.

    Yields
    ------
    FloatArray
        The crop's picture by each of its methods, float32 (h, w, 3), scene units.
    """
    step = lcm(2, study.tile.pattern.period)  # keeps the phase of both filter patterns
    rows = _around(crop.row, crop.height, truth.shape[0], step)
    columns = _around(crop.column, crop.width, truth.shape[1], step)
    pattern, window = study.tile.pattern, (rows, columns)
    cameras = CameraPair(crop.level, study.seed, truth, pattern, crop.scene.neutral, window)
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
