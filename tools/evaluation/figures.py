"""Figures of an evaluation, per scene and pooled: who wins, by how much, and where we lose."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import isnan, nan

import numpy as np

from .criteria import CRITERIA, RGB
from .measures import Histogram, Measures
from .methods import methods
from .metrics import Quality
from .scene_sets import SETS
from .strokes import Strokes
from .study import Cell, Study, can_photograph
from .tiles import Tile


@dataclass(frozen=True)
class Figure:
    """Figures of one method on a scene, or on a set of scenes.

    group: the set.
    scene: its name; None for the whole set.
    level: noise level, as in `Protocol`.
    method: its name.
    tile: the pattern of the sparse-colour camera; None for a Bayer camera's method.
    quality: PSNR quantiles of the scene's patches, or of all patches of the set, dB.
    psnr: of the whole picture in RGB, luminance and chrominance, dB; for a set, the mean over its scenes.
    ssim: of the whole picture; for a set, the mean over its scenes.
    wrong_hue: share of the pixels that show a wrong hue, 0 to 1; for a set, the mean over its scenes. None where red, green and
        blue are not measured.
    scenes: number of scenes.
    """

    group: str
    scene: str | None
    level: float
    method: str
    tile: Tile | None
    quality: Quality
    psnr: tuple[float, float, float]
    ssim: float
    wrong_hue: float | None
    scenes: int

    @property
    def values(self) -> tuple[float, ...]:
        """The figure by each of CRITERIA: PSNR in dB, SSIM, and % of wrong hue (NaN if there is none)."""
        tenths = (plane[0] for plane in self.quality)
        return (*self.quality.median, *tenths, *self.psnr, self.ssim, nan if self.wrong_hue is None else 100 * self.wrong_hue)


@dataclass(frozen=True)
class Comparison:
    """Ours beside one rival by one figure.

    scene: its name; None for the whole set.
    level: noise level, as in `Protocol`.
    criterion: place in CRITERIA.
    rival: name of the method.
    lead: how much better ours is, in the unit of the criterion.
    """

    scene: str | None
    level: float
    criterion: int
    rival: str
    lead: float

    @property
    def lost(self) -> bool:
        """Whether the rival is better by more than counts as none."""
        return self.lead <= -CRITERIA[self.criterion].even


Find = Callable[[str], Figure | None]  # the figure of a method
_Key = tuple[str, float, str, Tile | None]  # set or scene, level, method, pattern


class Figures:
    """All figures of a study, from the results that exist.

    strokes: what each method keeps of the drawn scene.
    """

    def __init__(self, study: Study, results: dict[Cell, Measures], strokes: Sequence[Strokes] = ()) -> None:
        self.study = study
        self.results = results
        self.strokes = tuple(strokes)
        present = {cell.scene.group for cell in results}
        self.groups = [group for group in SETS if group in present]
        self.scenes = {
            (cell.scene.name, *place): Figure(
                cell.scene.group, cell.scene.name, *place, each.quality, each.psnr, each.ssim, each.wrong_hue, 1
            )
            for cell, each in results.items()
            for place in [(cell.level, cell.method, cell.tile)]
        }

    @cached_property
    def pools(self) -> dict[_Key, Figure]:
        """Pooled figures by set, level, method and pattern; only where every scene of the set has a result."""
        parts: dict[_Key, list[Measures]] = {}
        for cell, measures in self.results.items():
            parts.setdefault((cell.scene.group, cell.level, cell.method, cell.tile), []).append(measures)
        found = {}
        for key in sorted(parts, key=lambda key: self.groups.index(key[0])):
            each = parts[key]
            if len(each) == len(self.scene_names(key[0])):
                quality = Quality(*(Histogram.pooled([m.patches[plane] for m in each]).quantiles() for plane in range(3)))
                rgb, luminance, chrominance = np.mean([m.psnr for m in each], axis=0).tolist()
                ssim, hues = float(np.mean([m.ssim for m in each])), [m.wrong_hue for m in each if m.wrong_hue is not None]
                hue = float(np.mean(hues)) if len(hues) == len(each) else None
                found[key] = Figure(key[0], None, *key[1:], quality, (rgb, luminance, chrominance), ssim, hue, len(each))
        return found

    def pooled(self, group: str, level: float, method: str, tile: Tile | None = None) -> Figure | None:
        """The pooled figure of one set of scenes; None if there is none. tile: of the sparse camera, by default the study's."""
        return self.pools.get((group, level, method, self._tile(method, tile)))

    def of_scene(self, scene: str, level: float, method: str, tile: Tile | None = None) -> Figure | None:
        """The figure of one scene; None if there is none. tile: of the sparse camera, by default the study's."""
        return self.scenes.get((scene, level, method, self._tile(method, tile)))

    def _tile(self, method: str, tile: Tile | None) -> Tile | None:
        return (tile or self.study.tile) if methods()[method].sparse else None

    def scene_names(self, group: str) -> list[str]:
        """Names of the scenes of a set."""
        return [scene.name for scene in self.study.scenes if scene.group == group]

    @cached_property
    def ours(self) -> str | None:
        """The method that represents us: the best renderer in the study."""
        return next((name for name in ("best", "paper", "preview") if name in self.study.methods), None)

    @property
    def rivals(self) -> list[str]:
        """Methods of the Bayer sensor."""
        return [name for name in self.study.methods if not methods()[name].sparse]

    def winner(self, group: str, level: float, criterion: int) -> str | None:
        """The best method on a set at a level."""
        return _best(self.study.methods, partial(self.pooled, group, level), criterion)

    def winner_of_scene(self, scene: str, level: float) -> str | None:
        """The method with the highest median RGB PSNR on a scene."""
        return _best(self.study.methods, partial(self.of_scene, scene, level))

    def rival_of_scene(self, scene: str, level: float) -> str | None:
        """The rival with the highest median RGB PSNR on a scene."""
        return _best(self.rivals, partial(self.of_scene, scene, level))

    def margin(self, group: str, level: float, criterion: int = RGB) -> tuple[str, float] | None:
        """The best rival on a set at a level, and our lead over it in the unit of the criterion (negative: it leads)."""
        return self._margin(partial(self.pooled, group, level), criterion)

    def _margin(self, find: Find, criterion: int = RGB) -> tuple[str, float] | None:
        rival = _best(self.rivals, find, criterion)
        if rival is None or self.ours is None or (lead := leads(find, self.ours, rival)) is None:
            return None
        return rival, lead[criterion]

    def by_pattern(self, group: str, level: float, criterion: int, method: str | None = None) -> dict[Tile, float]:
        """The figure of each pattern at a level, where there is one. method: by default our renderer."""
        name = method or self.ours
        if name is None:
            return {}
        found = {tile: self.pooled(group, level, name, tile) for tile in self.study.tiles}
        values = {tile: figure.values[criterion] for tile, figure in found.items() if figure}
        return {tile: value for tile, value in values.items() if not isnan(value)}

    def best_pattern(self, group: str, level: float, criterion: int) -> Tile | None:
        """The best pattern for our renderer at a level."""
        values = self.by_pattern(group, level, criterion)
        return max(values, key=lambda tile: CRITERIA[criterion].sign * values[tile], default=None)

    def best_period(self, group: str, level: float) -> tuple[int, float] | None:
        """The best of the paper's patterns for our renderer, and its lead over the study's own pattern, dB of median RGB PSNR."""
        values = self.by_pattern(group, level, RGB)
        medians = {tile.period: value for tile, value in values.items() if tile.period}
        if not medians or self.study.tile not in values:
            return None
        best = max(medians, key=lambda period: medians[period])
        return best, medians[best] - values[self.study.tile]

    def scene_leads(self, group: str, level: float) -> list[float]:
        """Our lead over the best rival of each scene, dB of median RGB PSNR; scenes without results are left out."""
        margins = [self._margin(partial(self.of_scene, name, level)) for name in self.scene_names(group)]
        return [margin[1] for margin in margins if margin is not None]

    def comparisons(self, group: str) -> list[Comparison]:
        """Ours beside every rival at every level by every criterion: on each scene, and on all together if there are several."""
        if self.ours is None:
            return []
        names = self.scene_names(group)
        return [
            Comparison(scene, level, criterion, rival, lead)
            for level in self.study.levels
            for scene in ([None, *names] if len(names) > 1 else names)
            for find in [partial(self.of_scene, scene, level) if scene is not None else partial(self.pooled, group, level)]
            for rival in self.rivals
            for criterion, lead in enumerate(leads(find, self.ours, rival) or ())
        ]

    def missing(self, group: str) -> dict[str, list[float]]:
        """Methods, with the levels at which a scene has no result of them, so that they are missing from the pooled figures."""
        levels, channels = self.study.levels, {scene.channels for scene in self.study.scenes if scene.group == group}
        meant = [
            name
            for name in self.study.methods
            if any(can_photograph(tile, each) for tile in self.study.cameras(methods()[name]) for each in channels)
        ]
        found = {name: [level for level in levels if self.pooled(group, level, name) is None] for name in meant}
        return {name: without for name, without in found.items() if without}


def leads(find: Find, own: str, rival: str) -> list[float] | None:
    """How much better one method is than another, by each of CRITERIA; None where one of them has no result."""
    ours, theirs = find(own), find(rival)
    if ours is None or theirs is None:
        return None
    return [each.sign * (a - b) for each, a, b in zip(CRITERIA, ours.values, theirs.values, strict=True)]


def _best(names: Iterable[str], find: Find, criterion: int = RGB) -> str | None:
    """The best method by a criterion."""
    found = {name: each.values[criterion] for name in names if (each := find(name)) is not None}
    values = {name: CRITERIA[criterion].sign * value for name, value in found.items() if not isnan(value)}
    return max(values, key=lambda name: values[name], default=None)
