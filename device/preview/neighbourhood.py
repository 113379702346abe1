"""The panchromatic pixels around the colour sites of a pattern: what interpolates a site, and what
differs beside it.

Places are (row, column), counted from the origin of a block. All weights are multiples of 1/64.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from ...shared.arrays import BoolArray, DoubleArray
from ...shared.pattern import CfaPattern

Place = tuple[int, int]

UNIT = 64
"""Weights are multiples of 1 / UNIT."""
_CUBIC = 0.5
"""Share of cubic interpolation; the rest is linear. Half has the smallest error on photographs:
cubic alone overshoots at edges.
"""
_FARTHEST_SAMPLE = 2
"""Pixels from a scattered site to the samples that interpolate it along an axis, at most: others,
not on the axis, are nearer.
"""


@dataclass(frozen=True)
class Neighbourhood:
    """The panchromatic neighbourhood of the colour sites of a pattern."""

    pattern: CfaPattern

    def interpolation(self, site: Place, axis: int) -> dict[Place, float]:
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
        return {
            _moved(site, axis, step): weight
            for step, weight in zip(steps, exact(weights), strict=True)
        }

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
        places: list[Place] = []
        weights = np.empty(0)
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
        return {
            place: weight for place, weight in zip(places, exact(weights), strict=True) if weight
        }

    def differences(self, axis: int) -> list[tuple[Place, Place]]:
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
        sites = [
            (row, column) for row, column, _ in sorted(self.pattern.sites, key=lambda site: site[2])
        ]
        sides = [(site, self._sides(site, axis)) for site in sites]
        pairs = [
            (_moved(site, axis, steps[0]), _moved(site, axis, steps[1]))
            for site, steps in sides
            if steps
        ]
        return list(dict.fromkeys(pairs))  # sites side by side have the same

    def _is_clear(self, place: Place) -> bool:
        """True if a place, counted from the origin of a block, is panchromatic."""
        return bool(self._clear[place[0] % self.pattern.period, place[1] % self.pattern.period])

    @cached_property
    def _clear(self) -> BoolArray:
        return self.pattern.panchromatic_mask((self.pattern.period,) * 2, self.pattern.block_origin)


def _moved(place: Place, axis: int, step: int) -> Place:
    """The place some steps further along an axis: 0 down, 1 right."""
    return (place[0], place[1] + step) if axis == 1 else (place[0] + step, place[1])


def exact(weights: DoubleArray) -> list[float]:
    """Weights rounded to multiples of 1/64 whose sum is exactly 1."""
    units = np.rint(weights * UNIT)
    units[np.argmax(units)] += UNIT - units.sum()
    return (units / UNIT).tolist()


def _lagrange(steps: list[int]) -> DoubleArray:
    """Weights of samples at `steps` that give the value at 0 of the polynomial through them."""
    nodes = np.array(steps, float)
    return np.array(
        [np.prod([other / (other - node) for other in nodes if other != node]) for node in nodes]
    )
