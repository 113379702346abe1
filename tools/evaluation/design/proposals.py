"""The tiles that a search proposes, beside known ones, and what both judges say of them, for people and for machines."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from shared import CfaPattern
from shared.arrays import BoolArray

from ..figures import Figures as Measured
from .judge import FastJudge, Figures
from .search import Search
from .slow import slow_figures, tile_of

_SHOWN = 12
_KNOWN = ("K=6", "K=4", "kodak")


@dataclass(frozen=True, eq=False)
class Proposal:
    """A tile, and what the fast judge says of it.

    tile: K rows of K letters.
    name: "" for one without a name.
    light: multiple of what a Bayer sensor collects.
    score: weighted figures, dB.
    figures: one for each light.
    """

    tile: tuple[str, ...]
    name: str
    light: float
    score: float
    figures: tuple[Figures, ...]

    @classmethod
    def of(cls, search: Search, judge: FastJudge, tile: tuple[str, ...], name: str = "") -> "Proposal":
        """What is said of a tile."""
        return cls(tile, name, judge.light(tile), search.score(tile), search.judged(tile))

    @property
    def letters(self) -> str:
        """The tile as the argument `pattern` takes it."""
        return "/".join(self.tile)

    @property
    def title(self) -> str:
        """Its name, or its letters."""
        return self.name or self.letters

    @property
    def mean(self) -> Figures:
        """Mean over the lights."""
        return Figures(*np.mean(self.figures, axis=0).tolist())


def front(proposals: Sequence[Proposal]) -> BoolArray:
    """Which tiles no other one equals or beats in light, luminance and colour, and beats in one of them."""
    values = np.array([(each.light, each.mean.luminance, each.mean.colour) for each in proposals])
    beaten = [((values >= mine).all(axis=1) & (values > mine).any(axis=1)).any() for mine in values]
    return ~np.array(beaten, bool)


def proposed(search: Search, judge: FastJudge, every: Sequence[Proposal]) -> list[Proposal]:
    """The best dozen, which differ in size or in the number of colour sites as far as possible, then known tiles.

    every: all that was found, the best first.
    """
    kinds: dict[tuple[int, int], Proposal] = {}
    for each in every:
        kinds.setdefault((len(each.tile), each.letters.count("W")), each)
    varied = list(kinds.values())[:_SHOWN]
    varied += [each for each in every if each not in varied][: _SHOWN - len(varied)]
    known = [CfaPattern.of_letters(name).tile for name in _KNOWN] if judge.letters == "RGB" else []
    named = [Proposal.of(search, judge, tile, name) for tile, name in zip(known, _KNOWN, strict=False)]
    return sorted(varied, key=lambda each: -each.score) + named


def text_table(shown: Sequence[Proposal], measured: Measured | None) -> Iterator[str]:
    """The proposals as lines for people: means over the lights."""
    names = [*Figures._fields, *(f"{name}, measured" for name in Figures._fields if measured)]
    yield f"{'score':>6} {'light':>6}  " + "  ".join(names) + "   letters"
    for each in shown:
        values = [*each.mean, *(np.mean(_slow(each, measured), axis=0).tolist() if measured else ())]
        cells = "  ".join(f"{value:{len(name)}.2f}" for name, value in zip(names, values, strict=True))
        yield f"{each.score:6.2f} {each.light:6.2f}  {cells}   {each.letters}{f'   {each.name}' if each.name else ''}"


def records(shown: Sequence[Proposal], lights: Sequence[str], measured: Measured | None) -> Iterator[dict[str, Any]]:
    """The proposals for machines, the figures by light: "fast" as expected, "slow" as measured, dB."""
    for each in shown:
        slow = _slow(each, measured) if measured else []
        facts = {"name": each.name or None, "light": each.light, "score": each.score}
        fast = {light: figures._asdict() for light, figures in zip(lights, each.figures, strict=True)}
        found = {light: Figures(*figures)._asdict() for light, figures in zip(lights, slow, strict=False)}
        yield {"pattern": each.letters, **facts, "fast": fast, "slow": found or None}


def _slow(each: Proposal, measured: Measured) -> list[tuple[float, ...]]:
    return [slow_figures(measured, level, tile_of(each.tile)) for level in measured.study.levels]
