"""The search for tiles: all small ones up to symmetry, then simulated annealing from the best of each size.

Everything follows from the options and the seed, and a tile is judged once. So a search that begins again with what was judged
before takes the same way as one that was never interrupted.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations, product
from math import comb, exp
from pathlib import Path

import numpy as np

from shared import CfaPattern
from shared.arrays import IndexArray
from shared.errors import InputError
from shared.pattern import PANCHROMATIC, PERIODS
from shared.progress import SILENT, Progress
from shared.reading import read_text
from shared.writing import write_durably

from .judge import Figures

Tile = tuple[str, ...]
_MOST = 1500  # tiles of one size, about, among which all with as many colour sites are tried
_HOT, _COLD = 0.3, 0.01  # dB: loss that annealing takes in one of e steps, first and last
_TRIES = 1000  # of a random start
_BETWEEN = 100  # judged tiles between two saved states
_LARGEST_STATE = 1 << 28  # bytes


@dataclass(frozen=True)
class Limits:
    """Which tiles can be built.

    letters: of the colour filters; a tile has all of them.
    sizes: K, pixels.
    least, most: share of panchromatic pixels, 0 to 1.
    sites: rows of letters, of which W marks places that can have no colour filter; it repeats. () = every place can.
    Raises InputError for limits that no tile meets.
    """

    letters: str
    sizes: tuple[int, ...]
    least: float = 0.0
    most: float = 1.0
    sites: Tile = ()

    def __post_init__(self) -> None:
        if len(set(self.letters)) != len(self.letters) or len(self.letters) < 2 or PANCHROMATIC in self.letters:
            raise InputError(f"`channels` is {self.letters!r}, expected two or more different letters, without W")
        if not (self.letters.isascii() and self.letters.isalpha() and self.letters.isupper()):
            raise InputError(f"`channels` is {self.letters!r}, expected letters from A to Z")
        if wrong := [size for size in self.sizes if size not in PERIODS]:
            raise InputError(f"`sizes` holds {wrong[0]}, expected {PERIODS[0]} to {PERIODS[-1]}")
        if not 0 <= self.least <= self.most <= 1:
            raise InputError(f"`share` is {self.least:g} {self.most:g}, expected two rising numbers from 0 to 1")
        rows, columns = len(self.sites), len(self.sites[0]) if self.sites else 0
        if any(len(row) != columns for row in self.sites):
            raise InputError("`sites`: the rows differ in length")
        if rows and (wrong := [size for size in self.sizes if size % rows or size % columns]):
            raise InputError(f"`sites` repeats every {rows} x {columns} pixels, which does not divide `sizes` {wrong[0]}")

    def placed(self, tile: Tile) -> Tile | None:
        """The tile, moved, turned or mirrored so that it can be built; None if it cannot."""
        text = "".join(tile)
        if not (self.least <= text.count(PANCHROMATIC) / len(text) <= self.most and set(self.letters) <= set(text)):
            return None
        try:
            CfaPattern(tile)
        except InputError:
            return None
        if not self.sites:
            return tile
        open_ = "".join((self.sites[row % len(self.sites)] * len(tile))[: len(tile)] for row in range(len(tile)))
        for order in symmetries(len(tile)):
            moved = "".join(text[place] for place in order)
            if all(letter == PANCHROMATIC or free != PANCHROMATIC for letter, free in zip(moved, open_, strict=True)):
                return _rows(moved)
        return None


@cache
def symmetries(period: int) -> IndexArray:
    """The 8 K^2 ways to move, turn and mirror a repeating tile: for each, which place of it comes to each place, (8 K^2, K^2)."""
    places = np.arange(period**2).reshape(period, period)
    turned = [np.rot90(each, turns) for each in (places, places.T) for turns in range(4)]
    moved = [np.roll(each, shift, (0, 1)).ravel() for each in turned for shift in np.ndindex(period, period)]
    return np.array(moved, np.intp)


def canonical(tile: Tile, letters: str) -> Tile:
    """The one tile that stands for all that are alike: moved, turned, mirrored, and with red and blue exchanged.

    letters: of the colour filters, in the order in which they are preferred in the first places.
    """
    order = letters + PANCHROMATIC
    codes = np.array([order.index(letter) for letter in "".join(tile)], np.uint8)
    versions = [codes]
    if {"R", "B"} <= set(letters) <= set("RGB"):  # the spectra of photographs are alike for both
        exchange = np.array([order.index({"R": "B", "B": "R"}.get(letter, letter)) for letter in order], np.uint8)
        versions.append(exchange[codes])
    found = min(row.tobytes() for version in versions for row in version[symmetries(len(tile))])
    return _rows("".join(order[code] for code in found))


def small_tiles(period: int, count: int, letters: str) -> Iterator[Tile]:
    """Every tile with `count` colour sites that has all letters, one of those that are alike."""
    places = period**2
    sites = np.array([(0, *others) for others in combinations(range(1, places), count - 1)])
    moved = np.sort(symmetries(period)[:, sites], axis=2)
    codes = (moved * places ** np.arange(count)[::-1]).sum(axis=2).min(axis=0)
    seen = set()
    for index in np.unique(codes, return_index=True)[1]:
        for colours in product(letters, repeat=count):
            if set(colours) == set(letters):
                text = np.full(places, PANCHROMATIC)
                text[sites[index]] = colours
                seen.add(canonical(_rows("".join(text)), letters))
    yield from sorted(seen)


@dataclass(eq=False)
class Judged:
    """What a judge said of tiles, kept in a file, so that nothing is judged twice.

    judge: the judge.
    name: identifies it and its lights: what another one said does not count.
    path: of the file; None = nothing is kept.
    Raises InputError for a file that is none of ours, and OutputError where it cannot be written.
    """

    judge: Callable[[Tile], Sequence[Figures]]
    name: str = ""
    path: Path | None = None
    known: dict[Tile, tuple[Figures, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.path is not None and self.path.exists():
            try:
                document = json.loads(read_text(self.path, _LARGEST_STATE, "state of a search"))
                tiles = {
                    tuple(tile.split("/")): tuple(Figures(*each) for each in found) for tile, found in document["tiles"].items()
                }
                self.known = tiles if document["judge"] == self.name else {}
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                raise InputError(f"{self.path}: is no state of a search ({error}); delete it to begin again") from None

    def __call__(self, tile: Tile) -> tuple[Figures, ...]:
        """The figures of a tile, one for each light."""
        if tile not in self.known:
            self.known[tile] = tuple(self.judge(tile))
            if len(self.known) % _BETWEEN == 0:
                self.save()
        return self.known[tile]

    def save(self) -> None:
        """Write the file."""
        if self.path is not None:
            tiles = {"/".join(tile): found for tile, found in self.known.items()}
            write_durably(self.path, json.dumps({"judge": self.name, "tiles": tiles}).encode(), overwrite=True)


@dataclass(frozen=True, eq=False)
class Search:
    """A search.

    judged: the judge, with what it said before.
    limits: which tiles can be built.
    weights: what matters, by the names of `Figures`, not all 0.
    steps: of annealing, for each size.
    seed: of annealing.
    """

    judged: Judged
    limits: Limits
    weights: Mapping[str, float]
    steps: int
    seed: int

    def score(self, tile: Tile) -> float:
        """Weighted mean of the figures, and mean over the lights, dB."""
        total = sum(self.weights.values())
        found = [sum(weight * getattr(each, name) for name, weight in self.weights.items()) for each in self.judged(tile)]
        return float(sum(found) / len(found) / total)

    def run(self, progress: Progress = SILENT) -> list[Tile]:
        """All tiles that were judged and can be built, the best first. Raises InputError where there is none."""
        tried: dict[Tile, Tile] = {}
        try:
            for period in self.limits.sizes:
                self._every_small(period, tried, progress)
                self._anneal(period, tried, progress)
        finally:
            self.judged.save()
        if not tried:
            raise InputError("no tile meets these limits; allow more `sizes`, another `share`, or more `sites`")
        return [tried[tile] for tile in sorted(tried, key=lambda each: (-self.score(each), each))]

    def _every_small(self, period: int, tried: dict[Tile, Tile], progress: Progress) -> None:
        for count in range(len(self.limits.letters), period**2):
            colourings = sum(
                (-1) ** left * comb(len(self.limits.letters), left) * (len(self.limits.letters) - left) ** count
                for left in range(len(self.limits.letters))
            )
            if comb(period**2, count) * colourings > _MOST * 8 * period**2:
                return
            if not self.limits.least <= 1 - count / period**2 <= self.limits.most:
                continue
            tiles = list(small_tiles(period, count, self.limits.letters))
            progress.stage(f"all {period} x {period} tiles with {count} colour sites", len(tiles))
            for tile in tiles:
                self._try(tile, tried)
                progress.advance()

    def _anneal(self, period: int, tried: dict[Tile, Tile], progress: Progress) -> None:
        random = np.random.default_rng((self.seed, period))
        progress.stage(f"annealing {period} x {period} tiles", self.steps)
        known = [tile for tile in tried if len(tile) == period]
        current = max(known, key=lambda each: (self.score(each), each)) if known else self._start(period, random, tried)
        if current is None:
            return
        for step in range(self.steps):
            progress.advance()
            tile = canonical(self._changed(current, random), self.limits.letters)
            luck = random.random()
            if not self._try(tile, tried):
                continue
            gain = self.score(tile) - self.score(current)
            if gain >= 0 or luck < exp(gain / (_HOT * (_COLD / _HOT) ** (step / self.steps))):
                current = tile

    def _try(self, tile: Tile, tried: dict[Tile, Tile]) -> bool:
        """Judge a tile, unless it cannot be built."""
        if tile not in tried and (placed := self.limits.placed(tile)):
            self.judged(tile)
            tried[tile] = placed
        return tile in tried

    def _start(self, period: int, random: np.random.Generator, tried: dict[Tile, Tile]) -> Tile | None:
        """A tile to begin with where there are too many small ones to try them all: each letter once or more at random."""
        places, letters = period**2, self.limits.letters
        for _ in range(_TRIES):
            share = random.uniform(self.limits.least, self.limits.most)
            count = min(max(len(letters), round((1 - share) * places)), places - 1)
            text = np.full(places, PANCHROMATIC)
            text[random.choice(places, count, replace=False)] = (list(letters) * places)[:count]
            tile = canonical(_rows("".join(text)), letters)
            if self._try(tile, tried):
                return tile
        return None

    def _changed(self, tile: Tile, random: np.random.Generator) -> Tile:
        """The tile with another filter at one place, or with two places exchanged."""
        text = list("".join(tile))
        first, second = random.choice(len(text), 2, replace=False).tolist()
        if random.random() < 0.5:
            text[first] = str(random.choice([each for each in self.limits.letters + PANCHROMATIC if each != text[first]]))
        else:
            coloured = [place for place, letter in enumerate(text) if letter != PANCHROMATIC]
            first = int(random.choice(coloured))
            text[first], text[second] = text[second], text[first]
        return _rows("".join(text))


def _rows(text: str) -> Tile:
    side = round(len(text) ** 0.5)
    return tuple(text[start : start + side] for start in range(0, side**2, side))
