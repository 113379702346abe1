"""What the samples of a colour block say about the errors at its sites: small systems of equations, one block after the other."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray

from .compile import kernel, parallel_kernel, prange

_FAINTEST, _STRONGEST = 0.06, 3.0  # range of a chromaticity that weights an error of luminance, in units of grey


@parallel_kernel
def solve_jointly(
    light: FloatArray,
    samples: FloatArray,
    doubt: FloatArray,
    variance: FloatArray,
    channels: IndexArray,
    near: DoubleArray,
    mismatch: float,
    gamma: DoubleArray,
    rounds: int,
    out: DoubleArray,
) -> None:
    """The chromaticity of each block, by generalised least squares (see `offline.sites`).

    light, samples: luminance and sample at each site, (rows, columns, S).
    doubt: standard deviation of the error of luminance, (rows, columns).
    variance: variance of the noise at each site, > 0, (rows, columns, S).
    channels: (S,), channel of each site.
    near: (S, S), correlation of the errors of luminance.
    mismatch: share of variance that differs from site to site.
    gamma: (C,), weights of Eq. 7.
    rounds: how often the covariance is computed from the chromaticity before.
    out: (rows, columns, C), the chromaticities of Eqs. 8-9; replaced.
    """
    rows, columns, sites = light.shape
    count = len(gamma)
    grey = 1 / gamma.sum()
    for row in prange(rows):
        covariance, colour = np.empty((sites, sites)), np.empty(sites)
        whitened = np.empty((sites, count + 1))  # one column per channel, and the samples
        normal, right = np.empty((count, count)), np.empty((count, 2))
        for column in range(columns):
            power = np.float64(doubt[row, column]) ** 2
            if power == 0:
                continue
            for _ in range(rounds):
                for site in range(sites):
                    value = out[row, column, channels[site]]
                    colour[site] = min(max(value, _FAINTEST * grey), _STRONGEST * grey)
                _covariance(colour, power, near, mismatch, variance[row, column], covariance)
                _decompose(covariance)
                for site in range(sites):
                    for channel in range(count):
                        whitened[site, channel] = light[row, column, site] if channels[site] == channel else 0.0
                    whitened[site, count] = samples[row, column, site]
                _forward(covariance, whitened)
                # Eqs. 8-9 pull towards grey with the weight of one sample of variance sigma^2; in these units the weight is 1.
                for i in range(count):
                    for j in range(count):
                        total = 1.0 if i == j else 0.0
                        for site in range(sites):
                            total += whitened[site, i] * whitened[site, j]
                        normal[i, j] = total
                    total = grey
                    for site in range(sites):
                        total += whitened[site, i] * whitened[site, count]
                    right[i, 0], right[i, 1] = total, gamma[i]
                _decompose(normal)
                _forward(normal, right)
                _backward(normal, right)
                free, pull = 0.0, 0.0
                for i in range(count):
                    free += gamma[i] * right[i, 0]
                    pull += gamma[i] * right[i, 1]
                for i in range(count):
                    out[row, column, i] = right[i, 0] + right[i, 1] * (1 - free) / pull


@parallel_kernel
def settle(
    error: FloatArray,
    colour: FloatArray,
    power: FloatArray,
    variance: FloatArray,
    near: DoubleArray,
    mismatch: float,
    out: FloatArray,
) -> None:
    """The most probable error of luminance at each site, given the errors of the samples (see `offline.sites`).

    error: sample minus what luminance and chromaticity predict, (rows, columns, S).
    colour: chromaticity of the block in the channel of each site, (rows, columns, S).
    power: variance of `error` without noise, mean over the sites, (rows, columns); 0 = nothing is known.
    variance: variance of the noise at each site, (rows, columns, S).
    near, mismatch: as in `solve_jointly`.
    out: (rows, columns, S), written.
    """
    rows, columns, sites = error.shape
    for row in prange(rows):
        covariance, right, clipped = np.empty((sites, sites)), np.empty((sites, 1)), np.empty(sites)
        for column in range(columns):
            out[row, column] = 0
            mean = 0.0
            for site in range(sites):
                clipped[site] = max(np.float64(colour[row, column, site]), 0.0)
                mean += clipped[site] ** 2 / sites
            if power[row, column] == 0 or mean == 0:
                continue
            scale = power[row, column] / (mean * (1 + mismatch))
            _covariance(clipped, scale, near, mismatch, variance[row, column], covariance)
            for site in range(sites):
                right[site, 0] = error[row, column, site]
            _decompose(covariance)
            _forward(covariance, right)
            _backward(covariance, right)
            for site in range(sites):
                total = 0.0
                for other in range(sites):
                    total += near[site, other] * clipped[other] * right[other, 0]
                out[row, column, site] = scale * total


@parallel_kernel
def correct(
    error: FloatArray,
    power: FloatArray,
    variance: FloatArray,
    strengths: DoubleArray,
    inward: DoubleArray,
    outward: DoubleArray,
    out: FloatArray,
) -> None:
    """The most probable error of every channel at each site: `outward` (`inward` error / (strengths + variance / power)).

    error: sample minus render, (rows, columns, S).
    power: variance of one channel's error, (rows, columns); 0 = nothing is known.
    variance: variance of the noise, (rows, columns).
    strengths: (S,), eigenvalues of the errors' correlation.
    inward: (S, S), its eigenvectors, one per row.
    outward: (S * C, S), from these to the channels of all sites.
    out: (rows, columns, S * C), written.
    """
    rows, columns, sites = error.shape
    for row in prange(rows):
        part = np.empty(sites)
        for column in range(columns):
            if power[row, column] == 0:
                out[row, column] = 0
                continue
            noise = np.float64(variance[row, column]) / power[row, column]
            for k in range(sites):
                total = 0.0
                for site in range(sites):
                    total += inward[k, site] * error[row, column, site]
                part[k] = total / (strengths[k] + noise)
            for value in range(len(outward)):
                total = 0.0
                for k in range(sites):
                    total += outward[value, k] * part[k]
                out[row, column, value] = total


@kernel
def _covariance(
    colour: DoubleArray, power: float, near: DoubleArray, mismatch: float, noise: FloatArray, covariance: DoubleArray
) -> None:
    """Covariance of the samples' errors: luminance wrong by `power`, seen through `colour`; mismatch; noise."""
    sites = len(colour)
    mean = 0.0
    for site in range(sites):
        mean += colour[site] ** 2 / sites
    for i in range(sites):
        for j in range(sites):
            covariance[i, j] = power * colour[i] * near[i, j] * colour[j]
        covariance[i, i] += power * mismatch * mean + noise[i]


@kernel
def _decompose(matrix: DoubleArray) -> None:
    """Cholesky's lower triangle of a positive definite matrix, in place."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@kernel
def _forward(lower: DoubleArray, right: DoubleArray) -> None:
    """Solve lower x = right for each column of `right`, in place."""
    for column in range(right.shape[1]):
        for i in range(len(lower)):
            total = right[i, column]
            for k in range(i):
                total -= lower[i, k] * right[k, column]
            right[i, column] = total / lower[i, i]


@kernel
def _backward(lower: DoubleArray, right: DoubleArray) -> None:
    """Solve lower^T x = right for each column of `right`, in place."""
    for column in range(right.shape[1]):
        for i in range(len(lower) - 1, -1, -1):
            total = right[i, column]
            for k in range(i + 1, len(lower)):
                total -= lower[k, i] * right[k, column]
            right[i, column] = total / lower[i, i]
