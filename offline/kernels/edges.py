"""Transmission of luminance edges: exp(-e) of Eqs. 12-13, horizontal and vertical, for every pixel of a window.

The weight between neighbours n and n' is exp(-max(e[n], e[n'])), the lesser of their two transmissions. So weights are minima, and
an exponential is computed once per pixel and direction, not once per pair.
"""

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray

from .compile import kernel
from .functions import exponential, zeros
from .lanes import WIDTH, load, store

_LANES = WIDTH
_NONE = np.float32(0)
_ONE = np.float32(1)


@kernel
def transmission(
    light: FloatArray, period: int, smooth: FloatArray, slope: FloatArray, radii: NDArray[np.intp], through: FloatArray
) -> None:
    """Compute exp(-e_h) and exp(-e_v) of a window of whole patches. A patch without gradients has a transmission of 1.

    light: luminance of the window, with `reach` more pixels on every side and 3 LANES columns of slack at the right.
    period: K, rows and columns of a patch.
    smooth, slope: (scales, reach + 1), a Gaussian and its slope at distances 0, 1, ...
    radii: (scales,), the radius at which each ends.
    through: (2, rows + 2, LANES + columns + 2 LANES), written from row 1, column LANES on.
    """
    reach = smooth.shape[1] - 1
    rows, columns = light.shape[0] - 2 * reach, light.shape[1] - 2 * reach - 3 * _LANES
    width = columns + _LANES
    energy = zeros(2 * period * width).reshape(2, period, width)
    smoothed, sloped = zeros(light.shape[1]), zeros(light.shape[1])
    relative = zeros(2 * width).reshape(2, width)
    for top in range(0, rows, period):
        energy[:] = _NONE
        for row in range(period):
            for scale in range(len(radii)):
                radius = radii[scale]
                _filter_down(light, top + row + reach, columns + 2 * reach, smooth[scale], slope[scale], radius, smoothed, sloped)
                _add_energy(smoothed, sloped, columns, reach, smooth[scale], slope[scale], radius, energy, row)
        _over_mean(energy, columns, period, relative)
        for row in range(period):
            for axis in range(2):
                for column in range(0, columns, _LANES):
                    e = load(energy, (axis, row, column)) * load(relative, (axis, column))
                    store(through, (axis, top + row + 1, column + _LANES), exponential(e))


@kernel
def _filter_down(
    light: FloatArray,
    row: int,
    columns: int,
    smooth: FloatArray,
    slope: FloatArray,
    radius: int,
    smoothed: FloatArray,
    sloped: FloatArray,
) -> None:
    """Apply the vertical halves of both filters to one row. Written as differences of symmetric pairs, so that flat input gives
    exactly 0.
    """
    for column in range(0, columns, _LANES):
        sum_ = smooth[0] * load(light, (row, column))
        difference = _NONE * load(light, (row, column))
        for step in range(1, radius + 1):
            above, below = load(light, (row - step, column)), load(light, (row + step, column))
            sum_ += smooth[step] * (above + below)
            difference += slope[step] * (below - above)
        store(smoothed, column, sum_)
        store(sloped, column, difference)


@kernel
def _add_energy(
    smoothed: FloatArray,
    sloped: FloatArray,
    columns: int,
    reach: int,
    smooth: FloatArray,
    slope: FloatArray,
    radius: int,
    energy: FloatArray,
    row: int,
) -> None:
    """Apply the horizontal halves: add |G_hs * l|^2 to plane 0 of `energy`, |G_vs * l|^2 to plane 1."""
    for column in range(0, columns, _LANES):
        across = _NONE * load(smoothed, column)
        down = smooth[0] * load(sloped, column + reach)
        for step in range(1, radius + 1):
            across += slope[step] * (load(smoothed, column + reach + step) - load(smoothed, column + reach - step))
            down += smooth[step] * (load(sloped, column + reach + step) + load(sloped, column + reach - step))
        store(energy, (0, row, column), load(energy, (0, row, column)) + across * across)
        store(energy, (1, row, column), load(energy, (1, row, column)) + down * down)


@kernel
def _over_mean(energy: FloatArray, columns: int, period: int, relative: FloatArray) -> None:
    """Write -1 over the mean energy of each patch in a row of patches to all its columns (errata: the mean, not the sum)."""
    for axis in range(2):
        for left in range(0, columns, period):
            total = _NONE
            for row in range(period):
                for column in range(left, left + period):
                    total += energy[axis, row, column]
            relative[axis, left : left + period] = np.float32(-period * period) / total if total > _NONE else _NONE
