"""What the samples of a colour block say about the errors at its sites: small systems of equations, eight blocks in lanes."""

import numpy as np

from .arrays import Doubles2, Doubles3, Floats2, Floats3, Floats4, Ints1
from .compile import Pieces, kernel, parallel_kernel
from .lanes import WIDTH, load, quotient, store, where_less

_LANES = WIDTH // 2  # of float64
_LEAST = 1e-6  # of the variance of errors: what keeps equations solvable whose sites are all explained by one error


@parallel_kernel()
def share_out(
    pieces: Pieces,
    error: Floats3,
    colour: Floats3,
    fill_variance: Floats2,
    tint: Floats2,
    variance: Floats3,
    channels: Ints1,
    near: Doubles2,
    light: Floats3,
    tints: Floats4,
) -> None:
    """The most probable errors at each site, of luminance and of colour, given the errors of the samples (see `offline.sites`).

    error: sample minus picture, (rows, columns, S), in units of luminance.
    colour: share of luminance in the channel of each site, (rows, columns, S).
    fill_variance: variance of the error of luminance, (rows, columns).
    tint: variance of the error of colour, (rows, columns).
    variance: variance of the noise at each site, (rows, columns, S).
    channels: (S,), channel of each site.
    near: (S, S), correlation of errors at two sites.
    light: (rows, columns, S), written: errors of luminance.
    tints: (rows, columns, S, C), written: errors of the channels that leave luminance as it is.
    """
    columns, sites = error.shape[1:]
    count = tints.shape[3]
    for row in range(pieces[0], pieces[1]):
        covariance, right = np.empty((sites, sites, _LANES)), np.empty((sites, 1, _LANES))
        weight, noise, powers = np.empty((sites, _LANES)), np.empty((sites, _LANES)), np.empty((2, _LANES))
        lights, odds = np.empty((sites, _LANES)), np.empty((sites, count, _LANES))
        for group in range(0, columns, _LANES):
            for lane in range(_LANES):
                column = min(group + lane, columns - 1)  # the spare lanes of the last group repeat the last block
                powers[0, lane], powers[1, lane] = fill_variance[row, column], tint[row, column]
                for site in range(sites):
                    weight[site, lane] = max(np.float64(colour[row, column, site]), 0.0)
                    right[site, 0, lane] = error[row, column, site]
                    noise[site, lane] = variance[row, column, site]
            power, odd = load(powers, (0, 0)), load(powers, (1, 0))
            for i in range(sites):
                for j in range(sites):
                    same = (1.0 if channels[i] == channels[j] else 0.0) - 1 / count
                    store(covariance, (i, j, 0), near[i, j] * (power * load(weight, (i, 0)) * load(weight, (j, 0)) + odd * same))
                own = load(noise, (i, 0)) + _LEAST * (power + odd)
                store(covariance, (i, i, 0), load(covariance, (i, i, 0)) + own)
            _solve(covariance, right)
            lights[:], odds[:] = 0.0, 0.0
            for site in range(sites):
                for other in range(sites):
                    part = near[site, other] * load(right, (other, 0, 0))
                    store(lights, (site, 0), load(lights, (site, 0)) + power * load(weight, (other, 0)) * part)
                    for channel in range(count):
                        same = (1.0 if channels[other] == channel else 0.0) - 1 / count
                        store(odds, (site, channel, 0), load(odds, (site, channel, 0)) + odd * same * part)
            for lane in range(min(_LANES, columns - group)):
                uncertain = powers[0, lane] + powers[1, lane] > 0
                for site in range(sites):
                    light[row, group + lane, site] = lights[site, lane] if uncertain else 0.0
                    for channel in range(count):
                        tints[row, group + lane, site, channel] = odds[site, channel, lane] if uncertain else 0.0


@kernel
def _solve(matrix: Doubles3, right: Doubles3) -> None:
    """Solve matrix x = right for each column of `right`, in place; NaN if the symmetric matrix is not positive definite."""
    size, columns = len(matrix), right.shape[1]
    for i in range(size):
        pivot = load(matrix, (i, i, 0))
        inverse = where_less(0.0, pivot, quotient(1.0, pivot), np.nan)
        for k in range(i + 1, size):
            factor = load(matrix, (i, k, 0)) * inverse
            for j in range(k, size):
                store(matrix, (k, j, 0), load(matrix, (k, j, 0)) - factor * load(matrix, (i, j, 0)))
            for column in range(columns):
                store(right, (k, column, 0), load(right, (k, column, 0)) - factor * load(right, (i, column, 0)))
        store(matrix, (i, i, 0), inverse)
    for i in range(size - 1, -1, -1):
        for column in range(columns):
            total = load(right, (i, column, 0))
            for j in range(i + 1, size):
                total -= load(matrix, (i, j, 0)) * load(right, (j, column, 0))
            store(right, (i, column, 0), total * load(matrix, (i, i, 0)))
