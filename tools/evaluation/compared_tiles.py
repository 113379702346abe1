"""The filter patterns that are compared, each under a name for people, and the filters that it has
before a scene.
"""

from dataclasses import dataclass
from functools import lru_cache
from os.path import isfile
from pathlib import Path

import numpy as np

from ...shared import CfaPattern
from ..io.scene import RGB, Scene, scene_channels
from ..simulation.bayer import ORDER
from ..simulation.filters import Filters, filters_for


@dataclass(frozen=True)
class Tile:
    """A pattern of the sparse-colour camera.

    name: for people. pattern: the pattern.
    """

    name: str
    pattern: CfaPattern

    @classmethod
    def of_period(cls, period: int) -> "Tile":
        """The paper's pattern: one Bayer block per period; "K=6" for 6."""
        return cls(f"K={period}", CfaPattern.bayer(period, ORDER))

    @classmethod
    def named(cls, pattern: CfaPattern, source: str) -> "Tile":
        """A pattern that the user gave as letters or as a file, which lends it its name unless it
        is one of the paper's.

        source: what the user wrote. Raises InputError as `filters_for` does.
        """
        filters_of(pattern)
        if pattern == CfaPattern.bayer(pattern.period, ORDER):
            return cls.of_period(pattern.period)
        name = Path(source).stem if isfile(source) else pattern.name or source  # noqa: PTH113 (Path.is_file refuses long names)
        return cls(name, pattern)

    @property
    def period(self) -> int | None:
        """K of the paper's pattern; None for any other."""
        period = self.pattern.period
        return period if self.pattern == CfaPattern.bayer(period, ORDER) else None

    @property
    def light(self) -> float:
        """Light collected from a white scene, as a multiple of what a Bayer sensor collects."""
        return self.pattern.light_efficiency(1 / filters_of(self.pattern).unit)


def channels_of(pattern: CfaPattern) -> str:
    """The channels of the scenes for a pattern: red, green and blue if its filters are made of
    these.
    """
    channels = scene_channels(pattern.channels)
    return RGB if set(channels) <= set(RGB) else channels


@lru_cache(maxsize=256)
def filters_of(pattern: CfaPattern) -> Filters:
    """The filters of a pattern before any scene with its channels.

    Raises InputError as `filters_for` does.
    """
    channels = channels_of(pattern)
    dark = np.zeros((1, 1, len(channels)), np.float32)
    return filters_for(pattern, Scene(dark, "", channels=channels))
