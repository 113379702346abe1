"""What the samples of a colour block say about the errors at its sites: small systems of equations, one block after the other."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray

from .compile import kernel, parallel_kernel, prange

_LEAST = 1e-6  # of the variance of errors: what keeps equations solvable whose sites are all explained by one error
_FAINTEST, _STRONGEST = 0.06, 3.0  # range of a chromaticity that weights an error of luminance, in units of grey


@parallel_kernel("f4[:, :, ::1], f4[:, :, ::1], f4[:, ::1], f4[:, :, ::1], i8[::1], f8[:, ::1], f8, f8[::1], i8, f8[:, :, ::1]")
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


@parallel_kernel(
    "f4[:, :, ::1], f4[:, :, ::1], f4[:, ::1], f4[:, ::1], f4[:, :, ::1], i8[::1], f8[:, ::1], f4[:, :, ::1], f4[:, :, :, ::1]"
)
def share_out(
    error: FloatArray,
    colour: FloatArray,
    doubt: FloatArray,
    tint: FloatArray,
    variance: FloatArray,
    channels: IndexArray,
    near: DoubleArray,
    light: FloatArray,
    tints: FloatArray,
) -> None:
    """The most probable errors at each site, of luminance and of colour, given the errors of the samples (see `offline.sites`).

    error: sample minus picture, (rows, columns, S), in units of luminance.
    colour: share of luminance in the channel of each site, (rows, columns, S).
    doubt: variance of the error of luminance, (rows, columns).
    tint: variance of the error of colour, (rows, columns).
    variance: variance of the noise at each site, (rows, columns, S).
    channels: (S,), channel of each site.
    near: (S, S), correlation of errors at two sites.
    light: (rows, columns, S), written: errors of luminance.
    tints: (rows, columns, S, C), written: errors of the channels that leave luminance as it is.
    """
    rows, columns, sites = error.shape
    count = tints.shape[3]
    for row in prange(rows):
        covariance, right, weight = np.empty((sites, sites)), np.empty((sites, 1)), np.empty(sites)
        for column in range(columns):
            light[row, column] = 0
            tints[row, column] = 0
            power, odd = np.float64(doubt[row, column]), np.float64(tint[row, column])
            if power + odd <= 0:
                continue
            for site in range(sites):
                weight[site] = max(np.float64(colour[row, column, site]), 0.0)
                right[site, 0] = error[row, column, site]
            for i in range(sites):
                for j in range(sites):
                    same = 1.0 if channels[i] == channels[j] else 0.0
                    covariance[i, j] = near[i, j] * (power * weight[i] * weight[j] + odd * (same - 1 / count))
                covariance[i, i] += variance[row, column, i] + _LEAST * (power + odd)
            _decompose(covariance)
            _forward(covariance, right)
            _backward(covariance, right)
            for site in range(sites):
                for other in range(sites):
                    part = near[site, other] * right[other, 0]
                    light[row, column, site] += power * weight[other] * part
                    for channel in range(count):
                        same = 1.0 if channels[other] == channel else 0.0
                        tints[row, column, site, channel] += odd * (same - 1 / count) * part


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
