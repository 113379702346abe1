"""The tiles that a search proposes, beside known ones, and what both judges say of them, for people and for machines."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared import CfaPattern
from shared.arrays import BoolArray
from shared.pattern import PANCHROMATIC

from ..figures import Figures as Measured
from .judge import FastJudge, Figures
from .search import Search
from .slow import slow_figures

_SHOWN = 12
_KNOWN = ("K=6", "K=4", "kodak")


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
