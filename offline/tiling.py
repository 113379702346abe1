"""How a frame is rendered in bands of rows, and the domain (the frame mirrored out to whole patches): arithmetic only.

A band is a whole number of rows of cores (see `affinity`). Refinement reaches a few rows beyond each pixel, so the last rows of a
band can only be finished with the next one. Nothing is computed twice, and the picture does not depend on where bands begin.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from shared.arrays import BORDER, FloatArray, IndexArray
from shared.block_grid import BlockGrid

HALO = 2
"""Patches around a core that are solved with it. Fields are then off by at most 0.007, by 1e-4 rms (photographs): a tenth of the
error that a residual of 1e-3 leaves."""
DARK = 1e-6
"""Luminance, scene units, below which a pixel has no chromaticity that could be corrected."""
# Pixels of a region with its halo, down and across, and patches of a core. Few rows make low bands, which need less memory; longer
# regions solve less of their surroundings.
_REGION, _LEAST_CORE = (144, 288), 8
# The least number of rows of a band, so that every thread has work. Wide frames need fewer rows for that: their bands have about
# `_ENOUGH` pixels, so that the planes of a band fit in the cache and their memory is reused.
_BAND, _ENOUGH = 192, 400_000


@dataclass(frozen=True)
class Band:
    """One step of a rendering from top to bottom. All pairs are a first index and an end.

    patches: the rows of patches whose fields are solved in this step.
    rows: the rows of the frame that are finished with them; none if both are equal.
    first: the first row of the frame that refinement of these rows looks at.
    """

    patches: tuple[int, int]
    rows: tuple[int, int]
    first: int


def core_patches(period: int) -> tuple[int, int]:
    """The number of rows, and of columns, of patches in the core of a region. period: K, pixels."""
    down, across = (max(_LEAST_CORE, pixels // period - 2 * HALO) for pixels in _REGION)
    return down, across


def bands(grid: BlockGrid, reach: int) -> list[Band]:
    """The bands of a frame, from top to bottom. reach: how many rows refinement looks up and down."""
    (above, _), _ = grid.padding
    (height, width), count = grid.frame, grid.patches[0]
    core, _ = core_patches(grid.period)
    step = -(-min(_BAND, -(-_ENOUGH // width)) // (core * grid.period)) * core
    found, done = [], 0
    for first in range(0, count, step):
        end = min(first + step, count)
        stop = height if end == count else max(end * grid.period - above - reach, done)
        found.append(Band((first, end), (done, stop), max(done - reach, 0)))
        done = stop
    return found


def domain_places(grid: BlockGrid, reach: int = 0) -> tuple[IndexArray, IndexArray]:
    """The frame row at each row of the domain, and the frame column at each of its columns.

    reach: number of rows and columns added at both ends, mirrored once more.
    """
    rows, columns = (
        np.pad(np.pad(np.arange(size), padding, mode=BORDER), reach, mode=BORDER)
        for size, padding in zip(grid.frame, grid.padding, strict=True)
    )
    return rows, columns


@dataclass(frozen=True, eq=False)
class Part:
    """Some rows of a picture.

    first: the frame's row that is its first.
    luminance: float32 (rows, W), scene units.
    chromaticity: float32 (rows, W, C).
    """

    first: int
    luminance: FloatArray
    chromaticity: FloatArray

    @property
    def end(self) -> int:
        """The frame's row after its last."""
        return self.first + len(self.luminance)

    def joined(self, below: "Part") -> "Part":
        """The rows of both parts, of which `below` follows this one."""
        pairs = (self.luminance, below.luminance), (self.chromaticity, below.chromaticity)
        return Part(self.first, *(np.concatenate(pair) for pair in pairs))

    def rows(self, first: int, end: int) -> "Part":
        """Rows `first` to `end` of the frame alone; views."""
        within = slice(first - self.first, end - self.first)
        return Part(first, self.luminance[within], self.chromaticity[within])


def windows(parts: Iterable[Part], height: int, reach: int, step: int, origin: int) -> Iterator[tuple[Part, tuple[int, int]]]:
    """Cut a picture that arrives in parts anew: yield (part, rows), where the part holds `reach` rows more on both sides of `rows`.

    parts: from top to bottom. height: rows of the whole picture.
    step, origin: `rows` end where (row - origin) is a multiple of `step`, or at the end of the picture.
    """
    held, done = None, 0
    for part in parts:
        held = part if held is None else held.joined(part)
        end = height if held.end == height else origin + (held.end - reach - origin) // step * step
        if end > done:
            yield held, (done, end)
            done = end
            held = held.rows(max(done - reach, held.first), held.end)
