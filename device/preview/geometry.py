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

Places are (row, column), counted from the origin of a block.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, product
from typing import NamedTuple

import numpy as np

from ...shared import BoolArray, CfaPattern, DoubleArray, FloatArray, InputError
from ...shared.site_errors import error_correlation

Place = tuple[int, int]

REACH = 1, 2
"""(rows, columns) of blocks beyond those at the corners of the patches whose colours are pooled."""
_CORNER = 1 / 8
"""Weight of each corner in a difference of smaller pictures. More would trust the direction too
much where there is noise.
"""
_UNIT = 64
"""Weights are multiples of 1 / _UNIT."""
_CUBIC = 0.5
"""Share of cubic interpolation; the rest is linear. Half has the smallest error on photographs:
cubic alone overshoots at edges.
"""
_FARTHEST_SAMPLE = 2
"""Pixels from a scattered site to the samples that interpolate it along an axis, at most: others,
not on the axis, are nearer.
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
            asked = f"a preview with one pixel per {self.scale} x {self.scale} sensor pixels"
            known = f"a pattern of period {period} has {', '.join(map(str, possible))}"
            raise InputError(f"{asked}: {known}")

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
        period, across, within = self.pattern.period, self.across, self.within
        masks = _masks(self.pattern, self.scale)
        masks = masks.reshape(across, within, across, within, period, period)
        return masks.transpose(1, 3, 0, 2, 4, 5).reshape(-1, period, period)

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
        first = 0 if self.scale == 1 else 2  # all of a site, or its channel
        return [[*sites] for _, sites in groupby(self.sites, key=lambda site: site[first:])]

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
        pooled = np.multiply(REACH, self.pattern.period).tolist()
        rows, columns = (
            (reach + half - window.start, reach - half + window.stop)
            for reach, half, window in zip(pooled, self.half, self.window, strict=True)
        )
        return *rows, *columns

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
            # A block at the top left corner of a patch begins in the patch before, -1.
            steps = zip(site, self.half, strict=True)
            (before, row), (left, column) = (divmod(step - half, period) for step, half in steps)
            pixel = row % side * side + column % side
            holes.append(Hole(pixel, row // side * self.across + column // side, -before, -left))
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
    def _probes(self) -> list[list[dict[Place, float]]]:
        readings = [[(row, column) for row, column, _ in sites] for sites in self.readings]
        return [
            *([self._mean_interpolation(sites, axis) for sites in readings] for axis in (1, 0)),
            *(self._steps(axis) for axis in (1, 0)),
            [dict.fromkeys(sites, 1.0) for sites in readings],
        ]

    def _mean_interpolation(self, sites: list[Place], axis: int) -> dict[Place, float]:
        """Weights whose sum of samples is the mean of the values that are interpolated at some
        sites.
        """
        weights: dict[Place, float] = {}
        for site in sites:
            for place, weight in self._interpolation(site, axis).items():
                weights[place] = weights.get(place, 0.0) + weight / len(sites)
        return dict(zip(weights, _exact(np.array([*weights.values()])), strict=True))

    def _steps(self, axis: int) -> list[dict[Place, float]]:
        """Weights of the differences along an axis; for a smaller picture one, between the
        panchromatic pixels at the corners.
        """
        if self.scale == 1:
            return [{after: 1.0, before: -1.0} for before, after in self._differences(axis)]
        if self.pattern.is_scattered:
            return [self._slope(axis)]
        height, width = self.pattern.block_shape
        corners = product((-1, height), (-1, width))
        return [{place: _CORNER if place[axis] >= 0 else -_CORNER for place in corners}]

    def _slope(self, axis: int) -> dict[Place, float]:
        """Weights of the sum of all differences across scattered sites, in which many cancel each
        other.
        """
        pairs = self._differences(axis)
        ends = Counter(after for _, after in pairs)
        ends.subtract(before for before, _ in pairs)
        left = {place: sign for place, sign in ends.items() if sign}
        # as much in all as four corners
        unit = max(round(4 * _CORNER / len(left) * _UNIT), 1) / _UNIT
        return {place: sign * unit for place, sign in left.items()}

    def _interpolation(self, site: Place, axis: int) -> dict[Place, float]:
        """Weights of the panchromatic samples along an axis that interpolate the value at a site;
        their sum is exactly 1.
        """
        steps = self._sides(site, axis)
        if self.pattern.is_scattered and (not steps or max(map(abs, steps)) > _FARTHEST_SAMPLE):
            return self._surface(site)
        before, after = steps
        weights = _lagrange(steps)
        wide = [before - 1, before, after, after + 1]
        if all(self._is_clear(_moved(site, axis, step)) for step in wide):
            steps = wide
            weights = _CUBIC * _lagrange(wide) + (1 - _CUBIC) * np.array([0, *weights, 0])
        places = [_moved(site, axis, step) for step in steps]
        return dict(zip(places, _exact(weights), strict=True))

    def _sides(self, site: Place, axis: int) -> list[int]:
        """Steps along an axis from a site to the panchromatic pixels before it and after it; empty
        if its line has none.
        """
        period = self.pattern.period
        clear = [step for step in range(1, period) if self._is_clear(_moved(site, axis, step))]
        return [clear[-1] - period, clear[0]] if clear else []

    def _surface(self, site: Place) -> dict[Place, float]:
        """Weights of the nearest panchromatic samples around a site that interpolate any plane
        there; their sum is exactly 1.
        """
        for reach in range(1, self.pattern.period):
            rows, columns = (range(place - reach, place + reach + 1) for place in site)
            places = [place for place in product(rows, columns) if self._is_clear(place)]
            steps = np.array(places).reshape(-1, 2) - site
            # of all solutions the one in which near samples count most
            near = 1 / np.hypot(*steps.T)
            plane = np.column_stack([np.ones(len(steps)), steps]).T * near
            scaled = np.linalg.pinv(plane) @ (1, 0, 0)
            weights = scaled * near
            if np.allclose(plane @ scaled, (1, 0, 0)):
                break
        exact = zip(places, _exact(weights), strict=True)
        return {place: weight for place, weight in exact if weight}

    def _differences(self, axis: int) -> list[tuple[Place, Place]]:
        """Pairs of panchromatic neighbours along an axis, within the block and one pixel around it.

        Where sites are scattered: of the panchromatic pixels on both sides of each, or along the
        other axis if no line has any.
        """
        if self.pattern.is_scattered:
            return self._across_sites(axis) or self._across_sites(1 - axis)
        height, width = self.pattern.block_shape
        places = product(range(-1, height + axis), range(-1, width + 1 - axis))
        pairs = [(place, _moved(place, axis, 1)) for place in places]
        return [pair for pair in pairs if all(map(self._is_clear, pair))]

    def _across_sites(self, axis: int) -> list[tuple[Place, Place]]:
        pairs = []
        for row, column, _ in self.sites:
            if steps := self._sides((row, column), axis):
                before, after = (_moved((row, column), axis, step) for step in steps)
                pairs.append((before, after))
        return list(dict.fromkeys(pairs))  # sites side by side have the same

    def _is_clear(self, place: Place) -> bool:
        """True if a place, counted from the origin of a block, is panchromatic."""
        return bool(self._clear[place[0] % self.pattern.period, place[1] % self.pattern.period])

    @cached_property
    def _clear(self) -> BoolArray:
        return self.pattern.panchromatic_mask((self.pattern.period,) * 2, self.pattern.block_origin)


def _masks(pattern: CfaPattern, side: int) -> FloatArray:
    """Masks of the panchromatic pixels of a patch that lie in each square of `side` pixels: 1 or 0,
    float32 (squares, K, K).
    """
    period, across = pattern.period, pattern.period // side
    clear = pattern.panchromatic_mask((period, period), pattern.block_middle)
    number = np.arange(period) // side
    index = number[:, None] * across + number
    return (clear & (index == np.arange(across**2)[:, None, None])).astype(np.float32)


def _moved(place: Place, axis: int, step: int) -> Place:
    """The place some steps further along an axis: 0 down, 1 right."""
    return (place[0], place[1] + step) if axis == 1 else (place[0] + step, place[1])


def _exact(weights: DoubleArray) -> list[float]:
    """Weights rounded to multiples of 1/64 whose sum is exactly 1."""
    units = np.rint(weights * _UNIT)
    units[np.argmax(units)] += _UNIT - units.sum()
    return (units / _UNIT).tolist()


def _lagrange(steps: list[int]) -> DoubleArray:
    """Weights of samples at `steps` that give the value at 0 of the polynomial through them."""
    nodes = np.array(steps, float)
    factors = [[other / (other - node) for other in nodes if other != node] for node in nodes]
    return np.array([np.prod(each) for each in factors])
