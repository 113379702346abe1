"""Photon transfer: fit variance over mean to get gain and read noise (J. R. Janesick, Photon Transfer, SPIE 2007; EMVA 1288)."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from shared.arrays import BoolArray, DoubleArray

from .samples import robust_deviation

_ROUNDS = 12
_LEAST_SHARE = 0.2  # of the variance that a place shows: its weight does not count on less
_HIGH = 4.0  # standard deviations above the line: beyond is texture, not noise


@dataclass(frozen=True)
class PhotonTransfer:
    """The line variance = shot * mean + read**2 of one plane, in parts of full scale.

    shot: variance per level.
    read: standard deviation without light.
    shot_error, read_error: their standard errors; infinite = the places do not determine them; 0 = given, not fitted.
    """

    shot: float
    read: float
    shot_error: float
    read_error: float

    def variance(self, mean: DoubleArray) -> DoubleArray:
        """Return the variance of a single sample at these means."""
        return self.shot * np.maximum(mean, 0) + self.read**2


def fit_photon_transfer(mean: DoubleArray, variance: DoubleArray, count: DoubleArray, read: float | None = None) -> PhotonTransfer:
    """Fit the line through the means and variances of N places of one plane; neither shot nor read is negative.

    An intercept that is fitted may be: then black is lower than it is taken for, which must not tilt the line.

    mean, variance: (N,), parts of full scale.
    count: (N,), number of samples; it gives the weight, because the variance of n samples has the variance 2 variance^2 / (n - 1).
    read: read noise from dark frames, parts of full scale; None = it is the line's intercept.

    Places far above the line have texture and are left out.
    """
    good = (count > 1) & np.isfinite(variance)
    mean, variance, count = mean[good], variance[good], count[good]
    design = np.stack([np.maximum(mean, 0), np.ones(mean.size)], axis=1)
    kept: BoolArray = np.ones(mean.size, bool)
    offset = 0.0 if read is None else read**2
    columns = design if read is None else design[:, :1]
    signed = np.concatenate([columns, -columns[:, 1:]], axis=1)
    predicted = np.maximum(variance, variance.mean() * 1e-3) if mean.size else variance
    coefficients = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        weight = np.sqrt((count - 1) / 2) / np.maximum(predicted, 1e-15)
        coefficients, _ = nnls(signed[kept] * weight[kept, None], (variance[kept] - offset) * weight[kept])
        predicted = np.maximum(signed @ coefficients + offset, np.maximum(_LEAST_SHARE * variance, 1e-15))
        score = (variance / predicted - 1) * np.sqrt((count - 1) / 2)
        kept = score <= _HIGH * max(1.0, robust_deviation(score))
        if kept.sum() < 2:
            kept = np.ones(mean.size, bool)
    weight = np.sqrt((count - 1) / 2) / predicted
    scaled = columns[kept] * weight[kept, None]
    information = scaled.T @ scaled
    # A pseudo-inverse would report an error of nearly 0 for what the places do not determine.
    determined = kept.any() and np.linalg.matrix_rank(information, hermitian=True) == len(information)
    errors = np.sqrt(np.diag(np.linalg.inv(information))) if determined else np.full(len(information), np.inf)
    # Places that differ by more than noise explains, as with texture, tell it less well.
    left = ((variance / predicted - 1) * np.sqrt((count - 1) / 2))[kept]
    errors = errors * max(1.0, float(np.sqrt((left**2).sum() / max(len(left) - len(information), 1))))
    shot = float(coefficients[0])
    if read is not None:
        return PhotonTransfer(shot, read, float(errors[0]), 0.0)
    intercept = float(np.sqrt(max(coefficients[1] - coefficients[2], 0.0)))
    read_error = float(errors[1] / (2 * max(intercept, np.sqrt(errors[1])))) if determined else np.inf
    return PhotonTransfer(shot, intercept, float(errors[0]), read_error)
