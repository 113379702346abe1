"""Figures of an evaluation, per scene and pooled: who wins, by how much, and whether the paper's claims hold."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .measures import PLANES, TITLES, Histogram, Measures
from .methods import methods
from .metrics import Quality
from .scene_sets import SETS
from .study import Cell, Study

RGB, LUMINANCE, CHROMINANCE, TENTH, WHOLE, HUE = range(6)  # places in CRITERIA
EVEN = 0.05  # dB: smaller differences count as none


@dataclass(frozen=True)
class Figure:
    """Figures of one method on a scene, or on a set of scenes.

    group: the set.
    scene: its name; None for the whole set.
    level: noise level, as in `Protocol`.
    method: its name.
    period: of the sparse-colour pattern, pixels; 0 for a rival.
    quality: PSNR quantiles of the scene's patches, or of all patches of the set, dB.
    psnr, ssim: PSNR (dB) and SSIM of the whole picture; for a set, the mean over its scenes.
    wrong_hue: share of the pixels that show a wrong hue, 0 to 1; for a set, the mean over its scenes.
    scenes: number of scenes.
    """

    group: str
    scene: str | None
    level: float
    method: str
    period: int
    quality: Quality
    psnr: float
    ssim: float
    wrong_hue: float
    scenes: int

    @property
    def values(self) -> tuple[float, ...]:
        """The figure by each of CRITERIA: dB, and % of wrong hue."""
        return (*self.quality.median, self.quality.rgb[0], self.psnr, 100 * self.wrong_hue)


class Criterion(NamedTuple):
    """One way to compare methods: medians say how most of a picture looks, the others how its worst places do.

    name: in the JSON file.
    title: for people.
    explanation: what the figure is, with its unit.
    sign: 1 where more is better, -1 where less is.
    """

    name: str
    title: str
    explanation: str
    sign: int = 1


_WORST_TENTH = "RGB PSNR that nine tenths of the patches reach (10 % quantile), dB; higher is better."
_WHOLE_IMAGE = "RGB PSNR of whole images, dB, mean over the scenes; higher is better."
_WRONG_HUE = "Pixels more than 10 CIEDE2000 from the truth, white balanced and at display exposure, %; lower is better."
_MEDIANS = tuple(zip(PLANES, TITLES, strict=True))
CRITERIA = (  # in the order of `Figure.values`
    *(Criterion(*each, f"Median {each[1]} PSNR of all patches, dB; higher is better.") for each in _MEDIANS),
    Criterion("rgb_q10", "worst tenth", _WORST_TENTH),
    Criterion("psnr", "whole image", _WHOLE_IMAGE),
    Criterion("wrong_hue", "wrong hue", _WRONG_HUE, -1),
)


@dataclass(frozen=True)
class Loss:
    """A scene and level at which a rival beats us, by `margin` dB of median RGB PSNR (positive)."""

    scene: str
    level: float
    rival: str
    margin: float


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, the finding ("shown", "shown in part", "refuted"), and the figures behind it."""

    text: str
    finding: str
    why: str


Find = Callable[[str], Figure | None]  # the figure of a method
_Key = tuple[str, float, str, int]  # set or scene, level, method, period


class Figures:
    """All figures of a study, from the results that exist."""

    def __init__(self, study: Study, results: dict[Cell, Measures]) -> None:
        self.study = study
        self.results = results
        present = {cell.scene.group for cell in results}
        self.groups = [group for group in SETS if group in present]
        self.scenes = {
            (cell.scene.name, *place): Figure(
                cell.scene.group, cell.scene.name, *place, each.quality, each.psnr, each.ssim, each.wrong_hue, 1
            )
            for cell, each in results.items()
            for place in [(cell.level, cell.method, cell.period)]
        }

    @cached_property
    def pools(self) -> dict[_Key, Figure]:
        """Pooled figures by set, level, method and period; only where every scene of the set has a result."""
        parts: dict[_Key, list[Measures]] = {}
        for cell, measures in self.results.items():
            parts.setdefault((cell.scene.group, cell.level, cell.method, cell.period), []).append(measures)
        found = {}
        for key in sorted(parts, key=lambda key: self.groups.index(key[0])):
            each = parts[key]
            if len(each) == len(self.scene_names(key[0])):
                quality = Quality(*(Histogram.pooled([m.patches[plane] for m in each]).quantiles() for plane in range(3)))
                psnr, ssim, hue = (float(np.mean([getattr(m, name) for m in each])) for name in ("psnr", "ssim", "wrong_hue"))
                found[key] = Figure(key[0], None, *key[1:], quality, psnr, ssim, hue, len(each))
        return found

    def pooled(self, group: str, level: float, method: str, period: int | None = None) -> Figure | None:
        """The pooled figure of one set of scenes; None if there is none. period: of the sparse sensor, by default the study's."""
        return self.pools.get((group, level, method, self._period(method, period)))

    def of_scene(self, scene: str, level: float, method: str, period: int | None = None) -> Figure | None:
        """The figure of one scene; None if there is none. period: of the sparse sensor, by default the study's."""
        return self.scenes.get((scene, level, method, self._period(method, period)))

    def _period(self, method: str, period: int | None) -> int:
        return (period or self.study.period) if methods()[method].ours else 0

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
        return [name for name in self.study.methods if not methods()[name].ours]

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

    def _scene_margin(self, scene: str, level: float) -> tuple[str, float] | None:
        return self._margin(partial(self.of_scene, scene, level))

    def _margin(self, find: Find, criterion: int = RGB) -> tuple[str, float] | None:
        rival = _best(self.rivals, find, criterion)
        if rival is None or self.ours is None or (lead := _lead(find, self.ours, rival)) is None:
            return None
        return rival, lead[criterion]

    def best_period(self, group: str, level: float) -> tuple[int, float] | None:
        """The best period for our renderer at a level, and its lead over the study's own period, dB of median RGB PSNR."""
        if self.ours is None or (own := self.pooled(group, level, self.ours)) is None:
            return None
        found = [f for period in self.study.periods if (f := self.pooled(group, level, self.ours, period)) is not None]
        best = max(found, key=lambda figure: figure.quality.median[RGB])
        return best.period, best.quality.median[RGB] - own.quality.median[RGB]

    def wins(self, group: str, level: float) -> tuple[int, int]:
        """(number of scenes on which we beat every rival in median RGB PSNR, number of scenes compared)."""
        margins = [margin for name in self.scene_names(group) if (margin := self._scene_margin(name, level)) is not None]
        return sum(lead > 0 for _, lead in margins), len(margins)

    def losses(self, group: str) -> list[Loss]:
        """Scenes and levels at which the best rival beats us, the largest margin first."""
        found = [
            Loss(name, level, margin[0], -margin[1])
            for level in self.study.levels
            for name in self.scene_names(group)
            if (margin := self._scene_margin(name, level)) is not None and margin[1] < -EVEN
        ]
        return sorted(found, key=lambda loss: -loss.margin)

    def claims(self, group: str) -> list[Claim]:
        """The two claims of section 4, tested with the paper's own method and its own rival where both were measured."""
        rival = next((name for name in ("dlmmse", "menon", *self.rivals) if name in self.rivals), None)
        own = "paper" if "paper" in self.study.methods else self.ours
        if rival is None or own is None:
            return []
        compared = [_lead(partial(self.pooled, group, level), own, rival) for level in self.study.levels]
        leads = [lead for lead in compared if lead is not None]
        if len(leads) < len(compared):
            return []
        claims = []
        if self.study.protocol.kind == "sensor" or self.study.levels[0] == 0:
            claims.append(self._noise_free(group, leads[0], own, rival))
        if len(leads) > 1:
            claims.append(self._growing(leads, own, rival))
        return claims

    def _noise_free(self, group: str, lead: list[float], own: str, rival: str) -> Claim:
        rgb, luminance, chrominance, *_ = lead
        level, protocol, names = self.study.levels[0], self.study.protocol, self.scene_names(group)
        by_scene = [_lead(partial(self.of_scene, name, level), own, rival) for name in names]
        ahead = sum(each is not None and each[RGB] > 0 for each in by_scene)
        mainly = luminance > max(chrominance, 0)
        finding = "refuted" if rgb <= EVEN else "shown" if mainly else "shown in part"
        light = "Noise-free" if protocol.kind == "paper" else f"At {protocol.describe(level)}"
        return Claim(
            f"{light}, better than Bayer, mainly in luminance",
            finding,
            f"{own} minus {rival}: {rgb:+.1f} dB RGB, {luminance:+.1f} dB luminance, {chrominance:+.1f} dB chrominance; "
            f"ahead in RGB on {ahead} of {len(names)} scenes",
        )

    def _growing(self, leads: list[list[float]], own: str, rival: str) -> Claim:
        by_plane = list(zip(*leads, strict=True))[: len(TITLES)]
        parts = [f"{name} " + ", ".join(f"{lead:+.1f}" for lead in each) for name, each in zip(TITLES, by_plane, strict=True)]
        first, last = by_plane[RGB][0], by_plane[RGB][-1]
        finding = "refuted" if last <= first + EVEN else "shown" if _rising(by_plane[RGB]) else "shown in part"
        noise = ", ".join(self.study.protocol.describe(level) for level in self.study.levels)
        return Claim("The more noise, the larger the lead", finding, f"{own} minus {rival}, dB, at {noise}: {'; '.join(parts)}")


def _best(names: Iterable[str], find: Find, criterion: int = RGB) -> str | None:
    """The best method by a criterion."""
    values = {name: CRITERIA[criterion].sign * each.values[criterion] for name in names if (each := find(name)) is not None}
    return max(values, key=lambda name: values[name], default=None)


def _lead(find: Find, own: str, rival: str) -> list[float] | None:
    """How much better one method is than another, by each of CRITERIA."""
    ours, theirs = find(own), find(rival)
    if ours is None or theirs is None:
        return None
    return [each.sign * (a - b) for each, a, b in zip(CRITERIA, ours.values, theirs.values, strict=True)]


def _rising(values: Iterable[float]) -> bool:
    """Whether each value is above the one before, or less than EVEN below."""
    return all(after > before - EVEN for before, after in pairwise(values))
