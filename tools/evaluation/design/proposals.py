"""The tiles that a search proposes, beside known ones, and what both judges say of them, for people and for machines.

The slow judge puts tiles before photographs, rendered by `best` and measured as `panchroma evaluate` does.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from shared import CfaPattern
from shared.arrays import BoolArray
from shared.pattern import PANCHROMATIC
from tools.camera.protocols import Protocol

from ..figures import TENTH_CHROMINANCE, WHOLE, WHOLE_CHROMINANCE, WHOLE_LUMINANCE
from ..figures import Figures as Measured
from ..scene_sets import Reading
from ..study import Study, collect, tasks
from ..team import Team
from ..tiles import Tile
from .judge import FastJudge, Figures
from .search import Search

_SHOWN = 12
_KNOWN = ("K=6", "K=4", "kodak")
METHOD = "best"
SLOW = (WHOLE_LUMINANCE, WHOLE_CHROMINANCE, TENTH_CHROMINANCE, WHOLE)
"""What evaluate measures of luminance, colour, worst colour and whole images, in the order of the fast judge's figures."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A tile, and what the fast judge says of it.

    tile: K rows of K letters.
    name: a number for one that the search found.
    light: multiple of what a Bayer sensor collects.
    score: weighted figures, dB, mean over the lights.
    figures: one for each light.
    slow: what the slow judge measured, likewise; () = nothing.
    """

    tile: tuple[str, ...]
    name: str
    light: float
    score: float
    figures: tuple[Figures, ...]
    slow: tuple[Figures, ...] = ()

    @classmethod
    def of(cls, search: Search, judge: FastJudge, tile: tuple[str, ...], name: str = "") -> "Proposal":
        """What is said of a tile."""
        return cls(tile, name, judge.light(tile), search.score(tile), search.judged(tile))

    @property
    def letters(self) -> str:
        """The tile as the argument `pattern` takes it."""
        return "/".join(self.tile)

    @property
    def mean(self) -> Figures:
        """Mean over the lights."""
        return _mean(self.figures)


def front(proposals: Sequence[Proposal]) -> BoolArray:
    """Which tiles no other one equals or beats in light, luminance and colour, and beats in one of them."""
    values = np.array([(each.light, each.mean.luminance, each.mean.colour) for each in proposals])
    beaten = [((values >= mine).all(axis=1) & (values > mine).any(axis=1)).any() for mine in values]
    return ~np.array(beaten, bool)


def proposed(search: Search, judge: FastJudge, every: Sequence[Proposal]) -> list[Proposal]:
    """The best dozen, then known tiles.

    Half of the dozen have their colour sites in one block, the others scatter them, because renders treat the two differently. As
    far as possible they differ in size or in the number of colour sites.

    every: all that was found, the best first.
    """
    dozen: list[Proposal] = []
    for scattered in (False, True):
        family = [each for each in every if CfaPattern(each.tile).is_scattered == scattered]
        kinds: dict[tuple[int, int], Proposal] = {}
        for each in family:
            kinds.setdefault((len(each.tile), each.letters.count(PANCHROMATIC)), each)
        varied = list(kinds.values())
        dozen += [*varied, *(each for each in family if each not in varied)][: _SHOWN // 2]
    known = [CfaPattern.of_letters(name).tile for name in _KNOWN] if judge.letters == "RGB" else []
    named = [Proposal.of(search, judge, tile, name) for tile, name in zip(known, _KNOWN, strict=False)]
    return [replace(each, name=each.name or str(place)) for place, each in enumerate(_ordered(dozen), 1)] + named


def photographed(
    tiles: Sequence[Tile],
    levels: Sequence[Protocol],
    sources: list[str],
    folder: Path,
    team: Team,
    reading: Reading,
    seed: int = 0,
    method: str = METHOD,
) -> Measured:
    """Measure tiles on scenes; what was measured before is kept in the folder. Raises InputError where nothing can be measured.

    levels: the light.
    sources: files and folders of scenes.
    reading: how they are read.
    seed: of the noise.
    method: name of the render.
    """
    scenes, _, _ = team.read(sources, folder, reading)
    study = Study(tuple(scenes), (method,), tuple(levels), tuple(tiles), seed, reading)
    team.measure(tasks(study, folder)[0])
    return Measured(study, collect(study, folder))


def slow_figures(measured: Measured, letters: Sequence[str]) -> tuple[Figures, ...]:
    """What was measured of the tile with these rows under each light, dB; NaN where it failed.

    Where there are several sets of scenes it is the mean over these.
    """
    tile = next(each for each in measured.study.tiles if each.pattern.tile == tuple(letters))
    method, found = measured.study.methods[0], []
    for level in measured.study.levels:
        rows = [each for group in measured.sets if (each := group.figure(level, method, tile=tile))]
        values = (float(np.mean([criterion.of(each) for each in rows])) if rows else nan for criterion in SLOW)
        found.append(Figures(*values))
    return tuple(found)


def spearman(one: Sequence[float], other: Sequence[float]) -> float:
    """Rank correlation of two lists of figures, -1 to 1; NaN where one does not vary. Equal figures share their mean rank."""
    from scipy.stats import rankdata

    with np.errstate(invalid="ignore"):
        return float(np.corrcoef(rankdata(one), rankdata(other))[0, 1])


def by_measurement(shown: Sequence[Proposal], measured: Measured, weights: Mapping[str, float]) -> list[Proposal]:
    """The proposals by the weighted figures that were measured, the best first, with that as their score."""
    total = np.array([weights.get(name, 0.0) for name in Figures._fields]) / sum(weights.values())
    found = [replace(each, slow=slow_figures(measured, each.tile)) for each in shown]
    return _ordered(replace(each, score=float(np.mean(each.slow @ total))) for each in found)


def text_table(shown: Sequence[Proposal]) -> Iterator[str]:
    """The proposals as lines for people: means over the lights."""
    names = [*Figures._fields, *(f"{name}, measured" for name in Figures._fields if shown[0].slow)]
    yield f"{'':5}  {'score':>5}  {'light':>5}  " + "  ".join(names) + "  letters"
    for each in shown:
        values = [*each.mean, *(_mean(each.slow) if each.slow else ())]
        cells = "  ".join(f"{value:{len(name)}.2f}" for name, value in zip(names, values, strict=True))
        yield f"{each.name:5}  {each.score:5.2f}  {each.light:5.2f}  {cells}  {each.letters}"


def records(shown: Sequence[Proposal], lights: Sequence[str]) -> Iterator[dict[str, Any]]:
    """The proposals for machines, the figures by light: "fast" as expected, "slow" as measured, dB."""
    for each in shown:
        fast, slow = (
            {light: figures._asdict() for light, figures in zip(lights, found, strict=False)} for found in (each.figures, each.slow)
        )
        facts = {"pattern": each.letters, "name": each.name, "light": each.light, "score": each.score}
        yield facts | {"fast": fast, "slow": slow or None}


def _mean(figures: Sequence[Figures]) -> Figures:
    return Figures(*np.mean(figures, axis=0).tolist())


def _ordered(proposals: Iterable[Proposal]) -> list[Proposal]:
    return sorted(proposals, key=lambda each: -each.score)
