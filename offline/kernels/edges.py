"""Transmission of luminance edges: exp(-e) of Eqs. 12-13, horizontal and vertical, for every pixel of a window.

The weight between neighbours n and n' is exp(-max(e[n], e[n'])), the lesser of their two transmissions. So weights are minima, and
an exponential is computed once per pixel and direction, not once per pair.
"""

import numpy as np

from .arrays import Floats1, Floats2, Floats3, Ints1, Scalar
from .compile import kernel
from .functions import exponential, zeros
from .lanes import WIDTH, load, store



Filters = tuple[Floats2, Floats2, Ints1]
Filter = tuple[Floats1, Floats1, int]


@kernel
def transmission(light: Floats2, period: int, filters: Filters, through: Floats3) -> None:
    """Compute exp(-e_h) and exp(-e_v) of a window of whole patches. A patch without gradients has a transmission of 1.

    light: luminance of the window, with `reach` more pixels on every side and 3 WIDTH columns of slack at the right.
    period: K, rows and columns of a patch.
    filters: (smooth, slope, radii), (scales, reach + 1) twice, a Gaussian and its slope at distances 0, 1, ..., and (scales,), the
        radius at which each ends.
    through: (2, rows + 2, WIDTH + columns + 2 WIDTH), written from row 1, column WIDTH on.
    """
    smooth, slope, radii = filters
    reach = smooth.shape[1] - 1
    rows, columns = light.shape[0] - 2 * reach, light.shape[1] - 2 * reach - 3 * WIDTH
    width = columns + WIDTH
    energy, relative = zeros(2, period, width), zeros(2, width)
    smoothed, sloped = zeros(light.shape[1]), zeros(light.shape[1])
    for top in range(0, rows, period):
        energy[:] = _ZERO
        for row in range(period):
            for scale in range(len(radii)):
                pair = smooth[scale], slope[scale], radii[scale]
                _filter_down(light, top + row + reach, columns + 2 * reach, pair, smoothed, sloped)
                _add_energy(smoothed, sloped, columns, reach, pair, energy, row)
        _over_mean(energy, columns, period, relative)
        for row in range(period):
            for axis in range(2):
                for column in range(0, columns, WIDTH):
                    e = load(energy, (axis, row, column)) * load(relative, (axis, column))
                    store(through, (axis, top + row + 1, column + WIDTH), exponential(e))


@kernel
def _filter_down(light: Floats2, row: int, columns: int, pair: Filter, smoothed: Floats1, sloped: Floats1) -> None:
    """Apply the vertical halves of both filters to one row.

    The slope is a sum of differences of symmetric pairs, so that flat input gives exactly 0.
    """
    smooth, slope, radius = pair
    for column in range(0, columns, WIDTH):
        sum_ = smooth[0] * load(light, (row, column))
        difference = _ZERO * load(light, (row, column))
        for step in range(1, radius + 1):
            above, below = load(light, (row - step, column)), load(light, (row + step, column))
            sum_ += smooth[step] * (above + below)
            difference += slope[step] * (below - above)
        store(smoothed, column, sum_)
        store(sloped, column, difference)


@kernel
def _add_energy(smoothed: Floats1, sloped: Floats1, columns: int, reach: int, pair: Filter, energy: Floats3, row: int) -> None:
    """Apply the horizontal halves: add |G_hs * l|^2 to plane 0 of `energy`, |G_vs * l|^2 to plane 1."""
    smooth, slope, radius = pair
    for column in range(0, columns, WIDTH):
        across = _ZERO * load(smoothed, column)
        down = smooth[0] * load(sloped, column + reach)
        for step in range(1, radius + 1):
            across += slope[step] * (load(smoothed, column + reach + step) - load(smoothed, column + reach - step))
            down += smooth[step] * (load(sloped, column + reach + step) + load(sloped, column + reach - step))
        store(energy, (0, row, column), load(energy, (0, row, column)) + across * across)
        store(energy, (1, row, column), load(energy, (1, row, column)) + down * down)


@kernel
def _over_mean(energy: Floats3, columns: int, period: int, relative: Floats2) -> None:
    """Write -1 / (mean energy of the patch) to all columns of each patch in a row of patches (errata: the mean, not the sum).

    Two patches at a time, both axes: each sum has to wait for its last element, four are as fast as one.
    """
    for left in range(0, columns, 2 * period):
        other = min(left + period, columns - period)  # if their number is odd, the last one twice
        a = b = c = d = _ZERO
        for row in range(period):
            for step in range(period):
                a += energy[0, row, left + step]
                b += energy[1, row, left + step]
                c += energy[0, row, other + step]
                d += energy[1, row, other + step]
        for step in range(period):
            relative[0, left + step], relative[1, left + step] = _over(a, period), _over(b, period)
            relative[0, other + step], relative[1, other + step] = _over(c, period), _over(d, period)


@kernel
def _over(total: Scalar, period: int) -> Scalar:
    """-1 over the mean of a patch whose sum is `total`; 0 without energy."""
    return np.float32(-period * period) / total if total > _ZERO else _ZERO
