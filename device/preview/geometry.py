"""The geometry of a preview graph: fixed weights and places that follow from the pattern alone.

**Probes** are weighted sums of the samples around a block: the luminance of each colour site
interpolated along its row and along
its column, differences of panchromatic samples along rows and along columns, and the colour samples
themselves. All weights are
small multiples of 1/64, so that a sum over 16-bit codes is exact in single precision: every
processor, and every order of
summation, gives the same bits.

A smaller picture reads the sites of a channel as one, by their mean, and has one difference per
axis. Then at most 16 probes read a Bayer block, which takes half the time of 17.

Where colour sites are scattered the tile is the block, with panchromatic pixels between its sites.
There luminance at a site comes from the nearest of them alone, and the differences are those across
the sites.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from ...shared import DoubleArray, FloatArray, IndexArray, InputError
from ...shared.pattern import CfaPattern
from ...shared.site_errors import error_correlation
from .neighbourhood import UNIT, Neighbourhood, Place, exact

REACH = 1, 2
"""(rows, columns) of blocks beyond those at the corners of the patches whose colours are pooled."""
_CORNER = 1 / 8
"""Weight of each corner in a difference of smaller pictures. More would trust the direction too
much where there is noise.
"""


class Hole(NamedTuple):
    """Place of a colour site in its patch.

    Attributes
    ----------
    pixel : int
        Index within its macropixel.
    macropixel : int
        Index of the macropixel.
    down, right : int
        0 or 1, the corner of the patch at which its block is.
    """

    pixel: int
    macropixel: int
    down: int
    right: int


@dataclass(frozen=True)
class Geometry:
    """The geometry of the preview of one pattern.

    Attributes
    ----------
    pattern : CfaPattern
        The filter pattern.
    scale : int
        Sensor pixels per picture pixel, each way; one of `scales(pattern)`.

    Raises
    ------
    InputError
        For another scale.
    """

    pattern: CfaPattern
    scale: int = 1

    def __post_init__(self) -> None:
        period, possible = self.pattern.period, self.scales(self.pattern)
        if self.scale not in possible:
            raise InputError(
                f"a preview with one pixel per {self.scale} x {self.scale} sensor pixels: a "
                f"pattern of period {period} has {', '.join(map(str, possible))}"
            )

    @staticmethod
    def scales(pattern: CfaPattern) -> tuple[int, ...]:
        """Possible scales of a preview, ascending: 1, and divisors of the period at which every
        pixel has panchromatic samples.
        """
        whole = (scale for scale in range(2, pattern.period + 1) if pattern.period % scale == 0)
        return (1, *(scale for scale in whole if _masks(pattern, scale).sum(axis=(1, 2)).all()))

    @property
    def half(self) -> Place:
        """(rows, columns) of a block that lie before the patch that begins in it."""
        return self.pattern.block_shape[0] // 2, self.pattern.block_shape[1] // 2

    @property
    def macropixel(self) -> int:
        """Side, in sensor pixels, of the square macropixels that share one chromaticity.

        Chromaticity changes more slowly than luminance. 2 x 2 pixels of the picture share one where
        they fit into a patch, as in 4:2:0 video: this saves a third of the time, and hardly shows
        in the JPEG.
        """
        return 2 * self.scale if self.pattern.period // self.scale % 2 == 0 else self.scale

    @property
    def within(self) -> int:
        """Number of pixels of the picture along a side of a macropixel."""
        return self.macropixel // self.scale

    @property
    def across(self) -> int:
        """Number of macropixels along a side of a patch."""
        return self.pattern.period // self.macropixel

    @cached_property
    def pixels(self) -> FloatArray:
        """Masks of the panchromatic pixels of a patch that lie in each pixel of the picture: 1 or
        0, float32 (pixels, K, K).

        Pixels have the order (pixels of a macropixel, macropixels), both row by row.
        """
        return _masks(self.pattern, self.scale)[self._order]

    @cached_property
    def window(self) -> tuple[range, range]:
        """(rows, columns) that the probes read, counted from the origin of a block."""
        used = np.array([place for kind in self._probes for probe in kind for place in probe])
        rows, columns = (range(int(axis.min()), int(axis.max()) + 1) for axis in used.T)
        return rows, columns

    @cached_property
    def readings(self) -> list[list[tuple[int, int, int]]]:
        """The sites of a block that are read as one, sorted by channel: each site alone; for a
        smaller picture, a channel's.
        """
        if self.scale == 1:
            return [[site] for site in self.sites]
        return [
            [site for site in self.sites if site[2] == channel]
            for channel in np.flatnonzero(self.pattern.site_counts)
        ]

    @cached_property
    def probes(self) -> FloatArray:
        """Weights of all probes, float32 (probes, window rows, window columns), kind by kind;
        `kinds` counts them.

        The kinds: interpolation along rows, along columns (one probe per reading each), differences
        along rows, along columns, and the samples themselves (one probe per reading).
        """
        rows, columns = self.window
        probes = [probe for kind in self._probes for probe in kind]
        weights = np.zeros((len(probes), len(rows), len(columns)), np.float32)
        for number, probe in enumerate(probes):
            for (row, column), weight in probe.items():
                weights[number, row - rows.start, column - columns.start] = weight
        return weights

    @property
    def kinds(self) -> tuple[int, ...]:
        """Number of probes of each kind, in the order of `probes`."""
        return tuple(map(len, self._probes))

    @property
    def halo(self) -> tuple[int, int, int, int]:
        """Sensor pixels above, below, left and right of the patches that the graph reads.

        Pooling of colours needs `REACH` more blocks beyond the corners of the patches, and those
        the window of their probes.
        """
        period = self.pattern.period
        sides = []
        for half, window, reach in zip(self.half, self.window, REACH, strict=True):
            sides += [reach * period + half - window.start, reach * period - half + window.stop]
        above, below, left, right = sides
        return above, below, left, right

    @cached_property
    def sites(self) -> list[tuple[int, int, int]]:
        """The sites of `CfaPattern.sites`, sorted by channel; probes and holes have this order."""
        return sorted(self.pattern.sites, key=lambda site: site[2])

    @property
    def holes(self) -> list[Hole]:
        """Places of the sites of a block in the patches around it, in the order of `sites`."""
        period, side = self.pattern.period, self.macropixel
        holes = []
        for *site, _ in self.sites:
            # A block at the top left corner of a patch begins in the patch before.
            (down, row), (right, column) = (
                (0, value - half) if value >= half else (1, value - half + period)
                for value, half in zip(site, self.half, strict=True)
            )
            pixel = row % side * side + column % side
            holes.append(Hole(pixel, row // side * self.across + column // side, down, right))
        return holes

    @property
    def luminance_errors(self) -> DoubleArray:
        """The linear map from the residual at the sites of a block to errors of luminance there,
        float64 (sites, sites).

        Both in the order of `sites`; the residual in units of luminance (see
        `shared.site_errors`).
        """
        every, measured = error_correlation(self.pattern)
        # of every channel at every site
        errors = np.linalg.solve(every[np.ix_(measured, measured)], every[measured]).T
        luminance = errors.reshape(len(self.sites), -1, len(self.sites)).sum(axis=1)
        order = [self.pattern.sites.index(site) for site in self.sites]
        return luminance[np.ix_(order, order)]

    @cached_property
    def _around(self) -> Neighbourhood:
        return Neighbourhood(self.pattern)

    @cached_property
    def _probes(self) -> list[list[dict[Place, float]]]:
        readings = [[(row, column) for row, column, _ in sites] for sites in self.readings]
        return [
            *([self._mean_interpolation(sites, axis) for sites in readings] for axis in (1, 0)),
            *(self._steps(axis) for axis in (1, 0)),
            [dict.fromkeys(sites, 1.0) for sites in readings],
        ]

    @property
    def _order(self) -> IndexArray:
        """Indices of the pixels of a patch, row by row, in the order of `pixels`."""
        across, within = self.across, self.within
        every = np.arange((across * within) ** 2).reshape(across, within, across, within)
        return every.transpose(1, 3, 0, 2).ravel()

    def _mean_interpolation(self, sites: list[Place], axis: int) -> dict[Place, float]:
        """Weights whose sum of samples is the mean of the values that are interpolated at some
        sites.
        """
        weights: dict[Place, float] = {}
        for site in sites:
            for place, weight in self._around.interpolation(site, axis).items():
                weights[place] = weights.get(place, 0.0) + weight / len(sites)
        return dict(zip(weights, exact(np.array([*weights.values()])), strict=True))

    def _steps(self, axis: int) -> list[dict[Place, float]]:
        """Weights of the differences along an axis; for a smaller picture one, between the
        panchromatic pixels at the corners.
        """
        if self.scale == 1:
            return [{after: 1.0, before: -1.0} for before, after in self._around.differences(axis)]
        if self.pattern.is_scattered:
            return [self._slope(axis)]
        height, width = self.pattern.block_shape
        corners = product((-1, height), (-1, width))
        return [{place: _CORNER if place[axis] >= 0 else -_CORNER for place in corners}]

    def _slope(self, axis: int) -> dict[Place, float]:
        """Weights of the sum of all differences across scattered sites, in which many cancel each
        other.
        """
        pairs = self._around.differences(axis)
        ends = Counter(after for _, after in pairs)
        ends.subtract(before for before, _ in pairs)
        left = {place: sign for place, sign in ends.items() if sign}
        # as much in all as four corners
        unit = max(round(4 * _CORNER / len(left) * UNIT), 1) / UNIT
        return {place: sign * unit for place, sign in left.items()}


def _masks(pattern: CfaPattern, side: int) -> FloatArray:
    """Masks of the panchromatic pixels of a patch that lie in each square of `side` pixels: 1 or 0,
    float32 (squares, K, K).
    """
    period, across = pattern.period, pattern.period // side
    clear = pattern.panchromatic_mask((period, period), pattern.block_middle)
    number = np.arange(period) // side
    index = number[:, None] * across + number
    return (clear & (index == np.arange(across**2)[:, None, None])).astype(np.float32)
