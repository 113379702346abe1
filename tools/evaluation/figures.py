"""Figures of an evaluation, per scene and pooled: by what methods are compared, a row for each, who is ahead by how much."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isnan, nan
from typing import NamedTuple

import numpy as np

from tools.simulation.noise import Protocol

from .measures import PLANES, TITLES, Histogram, Measures
from .methods import methods
from .metrics import QUANTILES, Quality
from .scene_sets import SETS, SceneInfo
from .study import Cell, Study, can_photograph
from .tiles import Tile

EVEN = 0.05  # dB: smaller differences count as none


class Criterion(NamedTuple):
    """One way to compare methods: medians say how most of a picture looks, the others how its worst places do.

    name: in the verdict of the JSON file.
    title: for people.
    figure: name of the value, see `Figure.values`.
    explanation: what the figure is, with its unit.
    sign: 1 where more is better, -1 where less is.
    unit: after a difference, for people.
    digits: decimals that people are shown.
    even: smaller differences count as none.
    scale: from the value to what people are shown.
    """

    name: str
    title: str
    figure: str
    explanation: str
    sign: int = 1
    unit: str = " dB"
    digits: int = 1
    even: float = EVEN
    scale: float = 1.0

    def of(self, figure: "Figure | None") -> float:
        """What people are shown; NaN if there is none."""
        value = None if figure is None else figure.values[self.figure]
        return nan if value is None else self.scale * value

    def text(self, value: float) -> str:
        """A figure for people; a dash where there is none (NaN)."""
        return "–" if isnan(value) else f"{value:.{self.digits}f}"

    def difference(self, lead: float) -> str:
        """A lead (positive: ours is better) as the difference of the figures, with its sign and unit."""
        return f"{self.sign * lead:+.{self.digits}f}{self.unit}"


_PLANES = [(of, name, "" if name == "rgb" else f"_{name}") for name, of in zip(PLANES, TITLES, strict=True)]
_MEDIAN = "PSNR of all patches, dB; higher is better."
_TENTH = "PSNR that nine tenths of the patches reach (10 % quantile), dB; higher is better."
_WHOLE = "PSNR of whole images, dB, mean over the scenes; higher is better."
_HUE = "Pixels more than 10 CIEDE2000 from the truth, white balanced and at display exposure, %; lower is better."
_UNEVEN = "Pixels whose error of a*, b* is 10 from that of the pixels around of the same true colour, %; lower is better."
_FADED = "How far the colour kept in five bins of luminance is from all of it, on the mean, %; lower is better."
CRITERIA = (
    *(Criterion(name, f"median {of}", f"{name}_q50", f"Median {of} {_MEDIAN}") for of, name, _ in _PLANES),
    *(Criterion(f"{name}_q10", f"worst tenth, {of}", f"{name}_q10", f"{of} {_TENTH}") for of, name, _ in _PLANES),
    *(Criterion(f"psnr{end}", f"whole image, {of}", f"psnr{end}", f"{of} {_WHOLE}") for of, _, end in _PLANES),
    Criterion("wrong_hue", "wrong hue", "wrong_hue", _HUE, -1, " % of the pixels", scale=100.0),
    Criterion("uneven_hue", "uneven hue", "uneven_hue", _UNEVEN, -1, " % of the pixels", scale=100.0),
    Criterion("faded", "faded colour", "faded", _FADED, -1, " %", even=0.5, scale=100.0),
)
RGB, LUMINANCE, CHROMINANCE, _, _, TENTH_CHROMINANCE, WHOLE, WHOLE_LUMINANCE, WHOLE_CHROMINANCE, HUE, _, _ = CRITERIA
"""Those of the worst tenth and of whole images without a name are those in RGB."""


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
        psnr_PLANE), dB; wrong_hue and uneven_hue, the shares of the pixels that show a wrong hue, and another one than their
        object does, 0 to 1, None where red, green and blue are not measured; kept_1 to kept_5, the slopes of `colour_kept` from
        dark to bright, and faded, the mean of their distances from 1, None where there is no colour. What is of whole pictures is
        the mean over the scenes; kept is of all their pixels.
    """

    group: str
    scene: str | None
    level: Protocol
    method: str
    tile: Tile | None
    scenes: int
    values: Mapping[str, float | None]


_Key = tuple[str, str | None, Protocol, str, Tile | None]  # set, scene, level, method, pattern


class Figures:
    """All figures of a study, from the results that exist.

    rows: of the sets, where every scene of a set has a result, then of the scenes.
    sets: those of which there are results.
    """

    def __init__(self, study: Study, results: Mapping[Cell, Measures]) -> None:
        self.study, self.results = study, results
        found: dict[_Key, Figure] = {}
        self.sets = [SetFigures(study, name, found) for name in SETS if any(cell.scene.group == name for cell in results)]
        parts: dict[_Key, list[Measures]] = {}
        for cell, measures in results.items():
            parts.setdefault((cell.scene.group, None, cell.level, cell.method, cell.tile), []).append(measures)
        for group in self.sets:
            whole = {key: each for key, each in parts.items() if key[0] == group.name and len(each) == len(group.names)}
            found |= {key: Figure(*key, len(each), _values(_pooled(each), each)) for key, each in whole.items()}
        for cell, measures in results.items():
            key = (cell.scene.group, cell.scene.name, cell.level, cell.method, cell.tile)
            found[key] = Figure(*key, 1, _values(measures.quality, [measures]))
        self.rows = found.values()

    def of(self, scene: SceneInfo) -> "SetFigures | None":
        """The set of a scene; None if nothing of it was measured."""
        return next((each for each in self.sets if each.name == scene.group), None)


@dataclass(frozen=True)
class Comparison:
    """Ours beside one rival by one figure.

    scene: its name; None for the whole set.
    level: the noise.
    criterion: the figure.
    rival: name of the method.
    lead: how much better ours is, in the unit of the criterion.
    """

    scene: str | None
    level: Protocol
    criterion: Criterion
    rival: str
    lead: float

    @property
    def lost(self) -> bool:
        """Whether the rival is better by more than counts as none."""
        return self.lead <= -self.criterion.even


@dataclass(frozen=True, eq=False)
class SetFigures:
    """The figures of one set of scenes. In all methods `scene` is a name, None = the whole set together.

    study: the study.
    name: of the set, one of SETS.
    found: the rows of the whole study.
    """

    study: Study
    name: str
    found: Mapping[_Key, Figure]

    @cached_property
    def names(self) -> list[str]:
        """Names of the scenes."""
        return [scene.name for scene in self.study.scenes if scene.group == self.name]

    def figure(self, level: Protocol, method: str, scene: str | None = None, tile: Tile | None = None) -> Figure | None:
        """The figures of a method; None if there are none. tile: of the sparse camera, by default the study's."""
        return self.found.get((self.name, scene, level, method, self.study.tile_of(method, tile)))

    def best(
        self, level: Protocol, criterion: Criterion = RGB, names: Iterable[str] | None = None, scene: str | None = None
    ) -> str | None:
        """The best of some methods, or of all, by a criterion."""
        chosen = self.study.methods if names is None else names
        values = {name: criterion.sign * criterion.of(self.figure(level, name, scene)) for name in chosen}
        return max((name for name in values if not isnan(values[name])), key=lambda name: values[name], default=None)

    def lead(
        self, level: Protocol, rival: str, criterion: Criterion = RGB, scene: str | None = None, own: str | None = None
    ) -> float | None:
        """How much better our method, or another one, is than a rival by a criterion; None where one has no result."""
        name, theirs = own or self.study.ours, self.figure(level, rival, scene)
        ours = self.figure(level, name, scene) if name else None
        return criterion.sign * (criterion.of(ours) - criterion.of(theirs)) if ours and theirs else None

    def margin(self, level: Protocol, criterion: Criterion = RGB, scene: str | None = None) -> Comparison | None:
        """Ours beside the best rival by a criterion; None if one of them has no such figure."""
        rival = self.best(level, criterion, self.study.rivals, scene)
        lead = None if rival is None else self.lead(level, rival, criterion, scene)
        return None if rival is None or lead is None or isnan(lead) else Comparison(scene, level, criterion, rival, lead)

    def margins(self, level: Protocol, criterion: Criterion = RGB) -> list[Comparison]:
        """Ours beside the best rival of each scene; scenes without results are left out."""
        return [margin for scene in self.names if (margin := self.margin(level, criterion, scene)) is not None]

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """Ours beside every rival at every level by every criterion: on each scene, and on all together if there are several."""
        return [
            Comparison(scene, level, criterion, rival, lead)
            for level in self.study.levels
            for scene in ([None, *self.names] if len(self.names) > 1 else self.names)
            for rival in self.study.rivals
            for criterion in CRITERIA
            if (lead := self.lead(level, rival, criterion, scene)) is not None
        ]

    def by_pattern(self, level: Protocol, criterion: Criterion = RGB, method: str | None = None) -> dict[Tile, float]:
        """The figure of each pattern at a level, where there is one. method: by default our renderer."""
        name = method or self.study.ours
        values = {tile: criterion.of(self.figure(level, name, tile=tile)) for tile in self.study.tiles} if name else {}
        return {tile: value for tile, value in values.items() if not isnan(value)}

    def best_pattern(self, level: Protocol, criterion: Criterion) -> Tile | None:
        """The best pattern for our renderer at a level."""
        values = self.by_pattern(level, criterion)
        return max(values, key=lambda tile: criterion.sign * values[tile], default=None)

    def missing(self) -> dict[str, list[Protocol]]:
        """Methods, with the levels at which a scene has no result of them, so that they are missing from the pooled figures."""
        channels = {scene.channels for scene in self.study.scenes if scene.group == self.name}
        meant = [
            name
            for name in self.study.methods
            if any(can_photograph(tile, each) for tile in self.study.cameras(methods()[name]) for each in channels)
        ]
        found = {name: [level for level in self.study.levels if self.figure(level, name) is None] for name in meant}
        return {name: without for name, without in found.items() if without}


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
    for name in ("wrong_hue", "uneven_hue"):
        mean = float(np.array([getattr(each, name) for each in parts], float).mean())
        values[name] = None if isnan(mean) else mean  # NaN where one picture has none
    seen, true = np.sum([each.kept for each in parts], axis=0)
    slopes = [_share(one, all_) for one, all_ in zip(seen, true, strict=True)]
    values |= {f"kept_{place}": slope for place, slope in enumerate(slopes, 1)}
    faded = [abs(1 - slope) for slope in slopes if slope is not None]
    values["faded"] = float(np.mean(faded)) if faded else None
    return values


def _share(one: float, all_: float) -> float | None:
    return float(one / all_) if all_ else None
