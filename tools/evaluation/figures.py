"""Figures of an evaluation, per scene and pooled, and who is ahead by how much."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import NamedTuple, TypeVar

import numpy as np

from tools.simulation.protocols import Protocol

from .measures import PLANES, Histogram, Measures
from .metrics import QUANTILES, Quality
from .scene_sets import SETS
from .study import Cell, Study
from .tiles import Tile

T = TypeVar("T")
EVEN = 0.05  # dB: smaller differences count as none


class Criterion(NamedTuple):
    """One way to compare methods: medians state how most of a picture looks, the others how its worst places do.

    name: in the verdict of the JSON file.
    title: of a column.
    figure: name of the value, see `Figure.values`.
    sign: 1 where more is better, -1 where less is, 0 where 100 is best.
    digits: decimals that people are shown.
    scale: from the value to what people are shown.
    """

    name: str
    title: str
    figure: str
    sign: int = 1
    digits: int = 1
    scale: float = 1.0

    def of(self, figure: "Figure | None") -> float | None:
        """What people are shown; None if there is none."""
        value = None if figure is None else figure.values[self.figure]
        return None if value is None else self.scale * value

    def score(self, figure: "Figure | None") -> float | None:
        """A number that is larger where the figure is better; None if there is none."""
        value = self.of(figure)
        return None if value is None else self.sign * value if self.sign else -abs(value - 100)

    def text(self, figure: "Figure | None") -> str:
        """A figure for people; a dash where there is none."""
        value = self.of(figure)
        return "–" if value is None else f"{value:.{self.digits}f}"


RGB = Criterion("rgb", "median RGB, dB", "rgb_q50")
TENTH = Criterion("rgb_q10", "10 % quantile, dB", "rgb_q10")
WHOLE = Criterion("psnr", "whole image, dB", "psnr")
HUE = Criterion("wrong_hue", "wrong hue, %", "wrong_hue", sign=-1, scale=100.0)
KEPT = Criterion("kept", "dark colour kept, %", "kept_1", sign=0, digits=0, scale=100.0)
CRITERIA = (
    RGB,
    Criterion("luminance", "luminance", "luminance_q50"),
    Criterion("chrominance", "chrominance", "chrominance_q50"),
    TENTH,
    Criterion("chrominance_q10", "chrominance", "chrominance_q10"),
    WHOLE,
    HUE,
    KEPT,
)


@dataclass(frozen=True)
class Figure:
    """Figures of one method on a scene, or on a set of scenes: a row of the results.

    group: the set.
    scene: its name; None for the whole set.
    level: the noise.
    method: its name.
    tile: the pattern of the sparse-colour camera; None for a Bayer camera's method.
    scenes: number of scenes.
    values: by name: PSNR quantiles of the patches of all scenes (PLANE_q10 to PLANE_q75) and PSNR of whole pictures (psnr,
        psnr_PLANE), dB; wrong_hue, the share of the pixels that show a wrong hue, 0 to 1, None where red, green and blue are not
        measured; kept_1 to kept_5, the slopes of `colour_kept` from dark to bright, None where there is no colour. What is of
        whole pictures is the mean over the scenes; kept is of all their pixels.
    """

    group: str
    scene: str | None
    level: Protocol
    method: str
    tile: Tile | None
    scenes: int
    values: Mapping[str, float | None]


@dataclass(frozen=True)
class Lead:
    """How much better ours is than the best rival of a scene, or of a set (scene None), by a criterion, dB."""

    scene: str | None
    level: Protocol
    criterion: Criterion
    rival: str
    value: float


_Key = tuple[str, str | None, Protocol, str, Tile | None]  # set, scene, level, method, pattern


class Figures:
    """All figures of a study, from the results that exist.

    groups: the sets of which there are results.
    rows: of the sets, where every scene of a set has a result, then of the scenes.
    """

    def __init__(self, study: Study, results: Mapping[Cell, Measures]) -> None:
        self.study, self.results = study, results
        self.groups = [name for name in SETS if any(cell.scene.group == name for cell in results)]
        parts: dict[_Key, list[Measures]] = {}
        for cell, measures in results.items():
            parts.setdefault((cell.scene.group, None, cell.level, cell.method, cell.tile), []).append(measures)
        pooled = {
            key: Figure(*key, len(each), _values(_pooled(each), each))
            for group in self.groups
            for key, each in parts.items()
            if key[0] == group and len(each) == len(self.scenes(group))
        }
        alone: dict[_Key, Figure] = {}
        for cell, measures in results.items():
            key = (cell.scene.group, cell.scene.name, cell.level, cell.method, cell.tile)
            alone[key] = Figure(*key, 1, _values(measures.quality, [measures]))
        self._found = pooled | alone
        self.rows = list(self._found.values())

    def scenes(self, group: str) -> list[str]:
        """Names of the scenes of a set."""
        return [scene.name for scene in self.study.scenes if scene.group == group]

    def of(self, group: str, level: Protocol, method: str, scene: str | None = None, tile: Tile | None = None) -> Figure | None:
        """The figures of a method; None if there are none. scene: None = the whole set; tile: by default the study's."""
        camera = (tile or self.study.tile) if self.study.method(method).ours else None
        return self._found.get((group, scene, level, method, camera))

    def best(self, group: str, level: Protocol, criterion: Criterion, names: Sequence[str], scene: str | None = None) -> str | None:
        """The best of some methods by a criterion; None where none has a figure."""
        scores = {name: criterion.score(self.of(group, level, name, scene)) for name in names}
        return _highest(scores)

    def lead(self, group: str, level: Protocol, criterion: Criterion = RGB, scene: str | None = None) -> Lead | None:
        """How much better ours is than the best rival; None if one of them has no such figure."""
        study = self.study
        rival = self.best(group, level, criterion, study.rivals, scene)
        theirs = criterion.score(self.of(group, level, rival, scene)) if rival else None
        ours = criterion.score(self.of(group, level, study.ours, scene)) if study.ours else None
        if rival is None or theirs is None or ours is None:
            return None
        return Lead(scene, level, criterion, rival, ours - theirs)

    def leads(self, group: str, level: Protocol, criterion: Criterion = RGB) -> list[Lead]:
        """The lead on each scene of a set; scenes without results are left out."""
        return [lead for scene in self.scenes(group) if (lead := self.lead(group, level, criterion, scene))]

    def best_tile(self, group: str, level: Protocol, criterion: Criterion) -> Tile | None:
        """The best pattern for our renderer."""
        name, tiles = self.study.ours, self.study.tiles
        return _highest({tile: criterion.score(self.of(group, level, name, tile=tile)) for tile in tiles}) if name else None


def _highest(scores: Mapping[T, float | None]) -> T | None:
    known = {key: score for key, score in scores.items() if score is not None}
    return max(known, key=lambda key: known[key], default=None)


def _pooled(parts: Sequence[Measures]) -> Quality:
    """Quantiles of the patches of all parts together."""
    return Quality(*(Histogram.pooled([each.patches[plane] for each in parts]).quantiles() for plane in range(len(PLANES))))


def _values(quality: Quality, parts: Sequence[Measures]) -> dict[str, float | None]:
    """`Figure.values` of some pictures. quality: of all their patches."""
    values: dict[str, float | None] = {
        f"{plane}_q{round(100 * quantile)}": value
        for plane, found in zip(PLANES, quality, strict=True)
        for quantile, value in zip(QUANTILES, found, strict=True)
    }
    whole = np.mean([each.psnr for each in parts], axis=0).tolist()
    values |= zip(("psnr", *(f"psnr_{plane}" for plane in PLANES[1:])), whole, strict=True)
    hue = float(np.array([each.wrong_hue for each in parts], float).mean())
    values["wrong_hue"] = None if isnan(hue) else hue  # NaN where one picture has none
    seen, true = np.sum([each.kept for each in parts], axis=0)
    for place, (one, all_) in enumerate(zip(seen, true, strict=True), 1):
        values[f"kept_{place}"] = float(one / all_) if all_ else None
    return values
