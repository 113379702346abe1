"""Figures of an evaluation: per scene and pooled, who wins and by how much, what becomes of the paper's claims."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .measures import PLANES, Histogram, Measures, rising
from .methods import Method, methods
from .metrics import Quality
from .scene_sets import SETS
from .study import Cell, Study

RGB, LUMINANCE, CHROMINANCE = range(3)
_SAME = 0.05  # dB: less is no difference


@dataclass(frozen=True)
class Figure:
    """Quantiles (dB) of a scene's patches, or of all patches of a set of scenes; whole-image figures, of a set their mean."""

    group: str
    scene: str | None
    level: float
    method: str
    period: int
    quality: Quality
    psnr: float
    ssim: float
    scenes: int


@dataclass(frozen=True)
class Loss:
    """Where a rival is ahead of us: a scene at a level, and by how many dB of median RGB PSNR (positive)."""

    scene: str
    level: float
    rival: str
    margin: float


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, what was found ("shown", "shown in part", "refuted"), and the figures that say so."""

    text: str
    finding: str
    why: str


class Figures:
    """All figures of a study, from the results that are there."""

    def __init__(self, study: Study, results: dict[Cell, Measures]) -> None:
        self.study = study
        self.results = results
        self.scenes = [_figure(cell, measures) for cell, measures in results.items()]
        self.groups = [group for group in SETS if any(figure.group == group for figure in self.scenes)]
        self._by_scene = {(f.scene, f.level, f.method, f.period): f for f in self.scenes}

    @cached_property
    def pools(self) -> list[Figure]:
        """Per set, level, method and period; only where every scene of the set has a result."""
        found = []
        for group in self.groups:
            count = sum(scene.group == group for scene in self.study.scenes)
            parts: dict[tuple[float, str, int], list[Measures]] = {}
            for cell, measures in self.results.items():
                if cell.scene.group == group:
                    parts.setdefault((cell.level, cell.method, cell.period), []).append(measures)
            for (level, method, period), each in parts.items():
                if len(each) == count:
                    quality = Quality(*(Histogram.pooled([m.patches[plane] for m in each]).quantiles() for plane in range(3)))
                    psnr, ssim = (float(np.mean([getattr(m, name) for m in each])) for name in ("psnr", "ssim"))
                    found.append(Figure(group, None, level, method, period, quality, psnr, ssim, count))
        return found

    @cached_property
    def _by_pool(self) -> dict[tuple[str, float, str, int], Figure]:
        return {(f.group, f.level, f.method, f.period): f for f in self.pools}

    def pooled(self, group: str, level: float, method: str, period: int | None = None) -> Figure | None:
        """Of a set; period: of ours, by default the study's."""
        return self._by_pool.get((group, level, method, self._period(method, period)))

    def of_scene(self, scene: str, level: float, method: str, period: int | None = None) -> Figure | None:
        """Of one scene."""
        return self._by_scene.get((scene, level, method, self._period(method, period)))

    @cached_property
    def ours(self) -> str | None:
        """The method that stands for us: the best render there is."""
        return next((name for name in ("best", "paper", "preview") if name in self.study.methods), None)

    @property
    def rivals(self) -> list[str]:
        """Methods of the Bayer sensor."""
        return [name for name in self.study.methods if not methods()[name].ours]

    def best_rival(self, find: Callable[[str], Figure | None], plane: int = RGB) -> Figure | None:
        """The rival with the highest median; find: method -> its figure."""
        found = [figure for figure in map(find, self.rivals) if figure is not None]
        return max(found, key=lambda figure: figure.quality.median[plane], default=None)

    def winner(self, group: str, level: float, plane: int) -> str | None:
        """The method with the highest pooled median at a level."""
        found = [figure for name in self.study.methods if (figure := self.pooled(group, level, name)) is not None]
        return max(found, key=lambda figure: figure.quality.median[plane]).method if found else None

    def best_of_scene(self, scene: str, level: float) -> str | None:
        """The method with the highest median RGB PSNR on a scene."""
        found = [figure for name in self.study.methods if (figure := self.of_scene(scene, level, name)) is not None]
        return max(found, key=lambda figure: figure.quality.median[RGB]).method if found else None

    def margin(self, group: str, level: float, plane: int = RGB) -> tuple[str, float] | None:
        """The best rival of a set at a level, and by how many dB of the median we are ahead of it (negative: behind)."""
        if self.ours is None:
            return None
        own = self.pooled(group, level, self.ours)
        rival = self.best_rival(lambda name: self.pooled(group, level, name), plane)
        if own is None or rival is None:
            return None
        return rival.method, own.quality.median[plane] - rival.quality.median[plane]

    def best_period(self, group: str, level: float) -> tuple[int, float] | None:
        """The period at which our best render is best at a level, and by how many dB of median RGB PSNR over the study's own."""
        found = [
            f for period in self.study.periods if self.ours and (f := self.pooled(group, level, self.ours, period)) is not None
        ]
        own = self.pooled(group, level, self.ours) if self.ours else None
        if not found or own is None:
            return None
        best = max(found, key=lambda figure: figure.quality.median[RGB])
        return best.period, best.quality.median[RGB] - own.quality.median[RGB]

    def wins(self, group: str, level: float) -> tuple[int, int]:
        """(scenes on which we are ahead of every rival in median RGB PSNR, scenes)."""
        margins = [margin for name in self._names(group) if (margin := self._scene_margin(name, level)) is not None]
        return sum(margin > 0 for _, margin in margins), len(margins)

    def losses(self, group: str) -> list[Loss]:
        """Where the best rival is ahead of us, the largest margin first."""
        found = []
        for level in self.study.levels:
            for name in self._names(group):
                margin = self._scene_margin(name, level)
                if margin is not None and margin[1] < -_SAME:
                    found.append(Loss(name, level, margin[0], -margin[1]))
        return sorted(found, key=lambda loss: -loss.margin)

    def claims(self, group: str) -> list[Claim]:
        """The two claims of section 4, held against the paper's own baseline and its own method where both were measured."""
        baseline = next((name for name in ("dlmmse", "menon", *self.rivals) if name in self.rivals), None)
        own = "paper" if "paper" in self.study.methods else self.ours
        if baseline is None or own is None:
            return []
        levels = self.study.levels
        differences = [self._difference(group, level, own, baseline) for level in levels]
        if any(difference is None for difference in differences):
            return []
        known = [difference for difference in differences if difference is not None]
        claims = []
        if self.study.protocol.kind == "sensor" or levels[0] == 0:
            claims.append(_noise_free(self, group, known[0], own, baseline))
        if len(levels) > 1:
            claims.append(_growing(self, known, own, baseline))
        return claims

    def _difference(self, group: str, level: float, own: str, rival: str) -> tuple[float, ...] | None:
        ours, theirs = self.pooled(group, level, own), self.pooled(group, level, rival)
        if ours is None or theirs is None:
            return None
        return tuple(a - b for a, b in zip(ours.quality.median, theirs.quality.median, strict=True))

    def _scene_margin(self, scene: str, level: float) -> tuple[str, float] | None:
        own = self.of_scene(scene, level, self.ours) if self.ours else None
        rival = self.best_rival(lambda name: self.of_scene(scene, level, name))
        if own is None or rival is None:
            return None
        return rival.method, own.quality.median[RGB] - rival.quality.median[RGB]

    def _names(self, group: str) -> Iterable[str]:
        return [scene.name for scene in self.study.scenes if scene.group == group]

    def _period(self, method: str, period: int | None) -> int:
        return (period or self.study.period) if methods()[method].ours else 0


def title(method: str) -> str:
    """A method's name for people."""
    known: Method = methods()[method]
    return known.title


def _figure(cell: Cell, measures: Measures) -> Figure:
    scene = cell.scene
    return Figure(scene.group, scene.name, cell.level, cell.method, cell.period, measures.quality, measures.psnr, measures.ssim, 1)


def _noise_free(figures: Figures, group: str, difference: tuple[float, ...], own: str, baseline: str) -> Claim:
    rgb, luminance, chrominance = difference
    level = figures.study.levels[0]
    ahead = sum(
        (a := figures.of_scene(name, level, own)) is not None
        and (b := figures.of_scene(name, level, baseline)) is not None
        and a.quality.median[RGB] > b.quality.median[RGB]
        for name in figures._names(group)
    )
    total = len(list(figures._names(group)))
    mainly = luminance > max(chrominance, 0)
    finding = "refuted" if rgb <= _SAME else "shown" if mainly else "shown in part"
    light = "Noise-free" if figures.study.protocol.kind == "paper" else f"At {figures.study.protocol.describe(level)}"
    return Claim(
        f"{light}, better than Bayer, mainly in luminance",
        finding,
        f"{own} minus {baseline}: {rgb:+.1f} dB RGB, {luminance:+.1f} dB luminance, {chrominance:+.1f} dB chrominance; "
        f"ahead in RGB on {ahead} of {total} scenes",
    )


def _growing(figures: Figures, differences: list[tuple[float, ...]], own: str, baseline: str) -> Claim:
    parts = []
    grows = []
    for plane, name in enumerate(PLANES):
        values = [difference[plane] for difference in differences]
        grows.append(rising(values, _SAME))
        parts.append(f"{'RGB' if name == 'rgb' else name} " + ", ".join(f"{value:+.1f}" for value in values))
    first, last = differences[0][RGB], differences[-1][RGB]
    finding = "shown" if grows[RGB] and last > first + _SAME else "shown in part" if last > first + _SAME else "refuted"
    noise = ", ".join(figures.study.protocol.describe(level) for level in figures.study.levels)
    return Claim("The more noise, the more better", finding, f"{own} minus {baseline}, dB, at {noise}: {'; '.join(parts)}")
