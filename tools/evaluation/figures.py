"""Figures of an evaluation, per scene and pooled: who wins, by how much, and where we lose."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isnan, nan

import numpy as np

from tools.camera.protocols import Protocol

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
    level: the noise.
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
    level: Protocol
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
    level: the noise.
    criterion: place in CRITERIA.
    rival: name of the method.
    lead: how much better ours is, in the unit of the criterion.
    """

    scene: str | None
    level: Protocol
    criterion: int
    rival: str
    lead: float

    @property
    def lost(self) -> bool:
        """Whether the rival is better by more than counts as none."""
        return self.lead <= -CRITERIA[self.criterion].even


_Key = tuple[str, Protocol, str, Tile | None]  # set or scene, level, method, pattern


@dataclass(frozen=True)
class Standing:
    """How the methods of a study stand in one place: on a scene or on a set of scenes, at one level, with the study's own pattern.

    study: the study.
    figures: by method, those that there are.
    """

    study: Study
    figures: Mapping[str, Figure]

    def best(self, names: Iterable[str] | None = None, criterion: int = RGB) -> str | None:
        """The best of some methods, or of all, by a criterion."""
        chosen = self.study.methods if names is None else names
        found = {name: self.figures[name].values[criterion] for name in chosen if name in self.figures}
        values = {name: CRITERIA[criterion].sign * value for name, value in found.items() if not isnan(value)}
        return max(values, key=lambda name: values[name], default=None)

    def leads(self, rival: str, own: str | None = None) -> list[float] | None:
        """How much better our method, or another one, is than a rival, by each of CRITERIA; None where one has no result."""
        ours, theirs = self.figures.get(own or self.study.ours or ""), self.figures.get(rival)
        if ours is None or theirs is None:
            return None
        return [each.sign * (a - b) for each, a, b in zip(CRITERIA, ours.values, theirs.values, strict=True)]

    def margin(self, criterion: int = RGB) -> tuple[str, float] | None:
        """The best rival, and our lead over it in the unit of the criterion (negative: it leads)."""
        rival = self.best(self.study.rivals, criterion)
        if rival is None or (lead := self.leads(rival)) is None:
            return None
        return rival, lead[criterion]


class Figures:
    """All figures of a study, from the results that exist.

    strokes: what each method keeps of the drawn scene.
    """

    def __init__(self, study: Study, results: dict[Cell, Measures], strokes: Sequence[Strokes] = ()) -> None:
        self.study = study
        self.results = results
        self.strokes = tuple(strokes)
        present = {cell.scene.group for cell in results}
        self.sets = [SetFigures(self, group) for group in SETS if group in present]
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
        return {
            key: _pooled(key, found)
            for each in self.sets
            for key, found in parts.items()
            if key[0] == each.name and len(found) == len(each.names)
        }

    def of_scene(self, scene: str, level: Protocol, method: str, tile: Tile | None = None) -> Figure | None:
        """The figure of one scene; None if there is none. tile: of the sparse camera, by default the study's."""
        return self.scenes.get((scene, level, method, self.study.tile_of(method, tile)))

    def at_scene(self, scene: str, level: Protocol) -> Standing:
        """How the methods stand on one scene."""
        found = {name: self.of_scene(scene, level, name) for name in self.study.methods}
        return Standing(self.study, {name: each for name, each in found.items() if each})


@dataclass(frozen=True)
class SetFigures:
    """The figures of one set of scenes.

    figures: those of the whole study.
    name: of the set, one of SETS.
    """

    figures: Figures
    name: str

    @property
    def study(self) -> Study:
        """The study."""
        return self.figures.study

    @property
    def names(self) -> list[str]:
        """Names of the scenes."""
        return [scene.name for scene in self.study.scenes if scene.group == self.name]

    def pooled(self, level: Protocol, method: str, tile: Tile | None = None) -> Figure | None:
        """The pooled figure; None if there is none. tile: of the sparse camera, by default the study's."""
        return self.figures.pools.get((self.name, level, method, self.study.tile_of(method, tile)))

    def at(self, level: Protocol) -> Standing:
        """How the methods stand on all scenes together."""
        found = {name: self.pooled(level, name) for name in self.study.methods}
        return Standing(self.study, {name: each for name, each in found.items() if each})

    def by_pattern(self, level: Protocol, criterion: int, method: str | None = None) -> dict[Tile, float]:
        """The figure of each pattern at a level, where there is one. method: by default our renderer."""
        name = method or self.study.ours
        if name is None:
            return {}
        found = {tile: self.pooled(level, name, tile) for tile in self.study.tiles}
        values = {tile: figure.values[criterion] for tile, figure in found.items() if figure}
        return {tile: value for tile, value in values.items() if not isnan(value)}

    def best_pattern(self, level: Protocol, criterion: int) -> Tile | None:
        """The best pattern for our renderer at a level."""
        values = self.by_pattern(level, criterion)
        return max(values, key=lambda tile: CRITERIA[criterion].sign * values[tile], default=None)

    def best_period(self, level: Protocol) -> tuple[int, float] | None:
        """The best of the paper's patterns for our renderer, and its lead over the study's own pattern, dB of median RGB PSNR."""
        values = self.by_pattern(level, RGB)
        medians = {tile.period: value for tile, value in values.items() if tile.period}
        if not medians or self.study.tile not in values:
            return None
        best = max(medians, key=lambda period: medians[period])
        return best, medians[best] - values[self.study.tile]

    def scene_leads(self, level: Protocol) -> list[float]:
        """Our lead over the best rival of each scene, dB of median RGB PSNR; scenes without results are left out."""
        margins = [self.figures.at_scene(name, level).margin() for name in self.names]
        return [margin[1] for margin in margins if margin is not None]

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """Ours beside every rival at every level by every criterion: on each scene, and on all together if there are several."""
        names = self.names
        return [
            Comparison(scene, level, criterion, rival, lead)
            for level in self.study.levels
            for scene in ([None, *names] if len(names) > 1 else names)
            for standing in [self.at(level) if scene is None else self.figures.at_scene(scene, level)]
            for rival in self.study.rivals
            for criterion, lead in enumerate(standing.leads(rival) or ())
        ]

    def missing(self) -> dict[str, list[Protocol]]:
        """Methods, with the levels at which a scene has no result of them, so that they are missing from the pooled figures."""
        channels = {scene.channels for scene in self.study.scenes if scene.group == self.name}
        meant = [
            name
            for name in self.study.methods
            if any(can_photograph(tile, each) for tile in self.study.cameras(methods()[name]) for each in channels)
        ]
        found = {name: [level for level in self.study.levels if self.pooled(level, name) is None] for name in meant}
        return {name: without for name, without in found.items() if without}


def _pooled(key: _Key, parts: Sequence[Measures]) -> Figure:
    """The figure of all scenes of a set together."""
    quality = Quality(*(Histogram.pooled([each.patches[plane] for each in parts]).quantiles() for plane in range(3)))
    rgb, luminance, chrominance = np.mean([each.psnr for each in parts], axis=0).tolist()
    hues = [each.wrong_hue for each in parts if each.wrong_hue is not None]
    hue = float(np.mean(hues)) if len(hues) == len(parts) else None
    ssim = float(np.mean([each.ssim for each in parts]))
    return Figure(key[0], None, *key[1:], quality, (rgb, luminance, chrominance), ssim, hue, len(parts))
