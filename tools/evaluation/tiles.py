"""The filter patterns that are compared, each under a name for people, and the filters that it has before a scene."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, count
from os.path import isfile
from pathlib import Path

import numpy as np

from shared import CfaPattern
from shared.errors import InputError
from tools.io.scene import Scene
from tools.simulation.bayer import ORDER
from tools.simulation.filters import Filters, filters_for

_SHORT = 24  # characters: longer tiles are named by their first row and their size


@dataclass(frozen=True)
class Tile:
    """A pattern of the sparse-colour camera.

    name: for people, unique in a study.
    pattern: the pattern.
    """

    name: str
    pattern: CfaPattern

    @classmethod
    def of_period(cls, period: int) -> "Tile":
        """The paper's pattern: one Bayer block per period; "K=6" for 6."""
        return cls(f"K={period}", CfaPattern.bayer(period, ORDER))

    @classmethod
    def named(cls, pattern: CfaPattern, source: str) -> "Tile":
        """A pattern that the user gave as letters or as a file, which lends it its name unless it is one of the paper's.

        source: what the user wrote.
        """
        if pattern == CfaPattern.bayer(pattern.period, ORDER):
            return cls.of_period(pattern.period)
        if isfile(source):  # noqa: PTH113 (Path.is_file raises for a name that is too long)
            return cls(Path(source).stem, pattern)
        letters = "/".join(pattern.tile)
        size = f"{pattern.tile[0]}/... ({pattern.period} x {pattern.period})"
        return cls(pattern.name or (letters if len(letters) <= _SHORT else size), pattern)

    @property
    def period(self) -> int | None:
        """K of the paper's pattern; None for any other."""
        return self.pattern.period if self.pattern == CfaPattern.bayer(self.pattern.period, ORDER) else None

    @property
    def title(self) -> str:
        """The name in a sentence: "K = 6"."""
        return self.name.replace("=", " = ") if self.period else self.name

    @property
    def letters(self) -> str:
        """The tile row by row, rows separated by "/"."""
        return "/".join(self.pattern.tile)

    @property
    def panchromatic_share(self) -> float:
        """Share of the pixels that are panchromatic, 0 to 1."""
        return 1 - len(self.pattern.sites) / self.pattern.period**2

    def light(self, channels: str) -> float:
        """Light collected from a white scene with these channels, as a multiple of what a Bayer sensor collects of R, G and B.

        Raises InputError as `filters_of` does.
        """
        colour = 1 / filters_of(self.pattern, channels).unit  # that one colour pixel collects; a panchromatic one collects 3
        return 3 * self.panchromatic_share + colour * (1 - self.panchromatic_share)

    def sees(self, channels: str) -> bool:
        """Whether the pattern's filters can be made from the channels of a scene."""
        try:
            filters_of(self.pattern, channels)
        except InputError:
            return False
        return True


@lru_cache(maxsize=256)
def filters_of(pattern: CfaPattern, channels: str) -> Filters:
    """The filters of a pattern before any scene with these channels. Raises InputError as `filters_for` does."""
    return filters_for(pattern, Scene(np.zeros((1, 1, len(channels)), np.float32), "", channels=channels))


def chosen_tiles(periods: Iterable[int], others: Iterable[Tile]) -> tuple[Tile, ...]:
    """Each pattern once and under a unique name: the paper's by rising period, then the others as they come."""
    found: list[Tile] = []
    for tile in chain(map(Tile.of_period, sorted(set(periods))), others):
        if any(tile.pattern == other.pattern for other in found):
            continue
        names = chain([tile.name], (f"{tile.name} ({number})" for number in count(2)))
        found.append(replace(tile, name=next(name for name in names if all(name != other.name for other in found))))
    return tuple(found)
