"""Where a preview graph looks: fixed weights and places that follow from the pattern alone.

**Probes** are weighted sums of the samples around a block: the luminance of each colour site interpolated along its row and along
its column, differences of neighbouring panchromatic samples along rows and along columns, and the colour samples themselves. All
weights are multiples of 1/64 and small, so that a sum over 16-bit codes is exact in single precision: every processor, and every
order of summation, gives the same bits.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError
from shared.pattern import CfaPattern

_UNIT = 64
_CUBIC = 0.5
"""Of cubic interpolation; the rest linear. Halfway has the smallest error on photographs: all cubic overshoots at edges."""

Place = tuple[int, int]


class Hole(NamedTuple):
    """A colour site as a pixel of its patch: which pixel of a cell, which cell; and which corner of the patch its block is at, one
    block further down or right than the first corner (1) or not (0).
    """

    pixel: int
    cell: int
    down: int
    right: int


@dataclass(frozen=True)
class Geometry:
    """Of the preview of one pattern with one picture pixel per `scale` x `scale` sensor pixels.

    Raises InputError when cells of that size do not fill a patch, or one holds no panchromatic pixel.
    """

    pattern: CfaPattern
    scale: int = 1

    def __post_init__(self) -> None:
        period, possible = self.pattern.period, self.scales(self.pattern)
        if self.scale not in possible:
            raise InputError(
                f"a preview with one pixel per {self.scale} x {self.scale} sensor pixels: a pattern of period {period} has "
                f"{', '.join(map(str, possible))}"
            )

    @staticmethod
    def scales(pattern: CfaPattern) -> tuple[int, ...]:
        """The scales that a preview of this pattern can have, in increasing order: divisors of the period, 1 always."""
        whole = (scale for scale in range(2, pattern.period + 1) if pattern.period % scale == 0)
        return (1, *(scale for scale in whole if _cells(pattern, scale).sum(axis=(1, 2)).all()))

    @property
    def half(self) -> Place:
        """Rows and columns of a block that lie before the patch that begins in it."""
        return self.pattern.block_shape[0] // 2, self.pattern.block_shape[1] // 2

    @property
    def cell(self) -> int:
        """Side, in sensor pixels, of the squares that share one chromaticity.

        It changes more slowly than luminance: at full resolution 2 x 2 pixels share one where the period is even, as in 4:2:0
        video, which costs 0.1 dB of median RGB PSNR and saves a third of the time.
        """
        if self.scale > 1:
            return self.scale
        return 2 if self.pattern.period % 2 == 0 else 1

    @property
    def across(self) -> int:
        """Cells across a patch."""
        return self.pattern.period // self.cell

    @cached_property
    def cells(self) -> FloatArray:
        """Which pixels of a patch are panchromatic and in each cell, 1 or 0; float32 (cells, K, K)."""
        return _cells(self.pattern, self.cell)

    @cached_property
    def window(self) -> tuple[range, range]:
        """Rows and columns, from a block's origin, that the probes read."""
        used = np.array([place for probe in self._probes for place in probe])
        rows, columns = (range(int(axis.min()), int(axis.max()) + 1) for axis in used.T)
        return rows, columns

    @cached_property
    def probes(self) -> FloatArray:
        """Weights, float32 (probes, window rows, window columns): along rows, along columns (a probe per site each), differences
        along rows, along columns (`differences` each), samples (one per site).
        """
        rows, columns = self.window
        weights = np.zeros((len(self._probes), len(rows), len(columns)), np.float32)
        for number, probe in enumerate(self._probes):
            for (row, column), weight in probe.items():
                weights[number, row - rows.start, column - columns.start] = weight
        return weights

    @property
    def kinds(self) -> tuple[int, int, int, int, int]:
        """How many probes of each kind there are, in order."""
        sites = len(self.sites)
        return sites, sites, len(self._differences(1)), len(self._differences(0)), sites

    @property
    def halo(self) -> tuple[int, int, int, int]:
        """Sensor pixels above, below, left and right of the patches that the graph reads.

        The pooling of chromaticities asks one block beyond the corners of the patches, and its probes their window.
        """
        period = self.pattern.period
        sides = []
        for half, window in zip(self.half, self.window, strict=True):
            sides += [period + half - window.start, period - half + window.stop]
        above, below, left, right = sides
        return above, below, left, right

    @cached_property
    def sites(self) -> list[tuple[int, int, int]]:
        """`CfaPattern.sites`, channel by channel: the order of probes and holes."""
        return sorted(self.pattern.sites, key=lambda site: site[2])

    @property
    def holes(self) -> list["Hole"]:
        """Where the sites of a block are in the patches around it, in the order of `sites`."""
        period, cell = self.pattern.period, self.cell
        holes = []
        for *site, _ in self.sites:
            # A block begins in the patch before the one that it is the first corner of.
            (down, row), (right, column) = (
                (0, value - half) if value >= half else (1, value - half + period)
                for value, half in zip(site, self.half, strict=True)
            )
            holes.append(Hole(row % cell * cell + column % cell, row // cell * self.across + column // cell, down, right))
        return holes

    @cached_property
    def _probes(self) -> list[dict[Place, float]]:
        sites = [(row, column) for row, column, _ in self.sites]
        return [
            *(self._interpolation(site, axis) for axis in (1, 0) for site in sites),
            *({after: 1.0, before: -1.0} for axis in (1, 0) for before, after in self._differences(axis)),
            *({site: 1.0} for site in sites),
        ]

    def _is_clear(self, place: Place) -> bool:
        """Whether a place, from a block's origin, is panchromatic."""
        period = self.pattern.period
        return (place[0] % period, place[1] % period) not in {(row, column) for row, column, _ in self.pattern.sites}

    def _interpolation(self, site: Place, axis: int) -> dict[Place, float]:
        """Weights of panchromatic samples along an axis that give the value at a site; they sum to one exactly."""

        def at(step: int) -> Place:
            return (site[0], site[1] + step) if axis == 1 else (site[0] + step, site[1])

        before = next(step for step in range(1, self.pattern.period) if self._is_clear(at(-step)))
        after = next(step for step in range(1, self.pattern.period) if self._is_clear(at(step)))
        steps = [-before, after]
        weights = _lagrange(steps)
        wide = [-before - 1, -before, after, after + 1]
        if all(self._is_clear(at(step)) for step in wide):
            steps, weights = wide, _CUBIC * _lagrange(wide) + (1 - _CUBIC) * np.array([0, *weights, 0])
        exact = np.rint(weights * _UNIT)
        exact[np.argmax(exact)] += _UNIT - exact.sum()
        return {at(step): float(weight) / _UNIT for step, weight in zip(steps, exact, strict=True)}

    def _differences(self, axis: int) -> list[tuple[Place, Place]]:
        """Neighbours along an axis, both panchromatic, in the rectangle that is the block and one pixel around it."""
        height, width = self.pattern.block_shape
        pairs = []
        for row in range(-1, height + 1 if axis == 1 else height):
            for column in range(-1, width + 1 if axis == 0 else width):
                other = (row, column + 1) if axis == 1 else (row + 1, column)
                if self._is_clear((row, column)) and self._is_clear(other):
                    pairs.append(((row, column), other))
        return pairs


def _lagrange(steps: list[int]) -> DoubleArray:
    """Weights of samples at `steps` for the value at 0 of the polynomial through them."""
    nodes = np.array(steps, float)
    weights: DoubleArray = np.array([np.prod([other / (other - node) for other in nodes if other != node]) for node in nodes])
    return weights


def _cells(pattern: CfaPattern, side: int) -> FloatArray:
    """Which pixels of a patch are panchromatic and in each cell; (cells, K, K), 1 or 0."""
    first = [origin + size // 2 for origin, size in zip(pattern.block_origin, pattern.block_shape, strict=True)]
    clear = pattern.filter_map((pattern.period, pattern.period), (first[0], first[1])) == len(pattern.channels)
    number = np.arange(pattern.period) // side
    index = number[:, None] * (pattern.period // side) + number
    cells: FloatArray = (clear & (index == np.arange((pattern.period // side) ** 2)[:, None, None])).astype(np.float32)
    return cells
