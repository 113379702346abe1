"""Eqs. 1-5: luminance under the colour filters, by shrinking undecimated wavelet coefficients."""

import math

import numpy as np
import pywt
from scipy.ndimage import gaussian_filter
from scipy.signal import convolve2d

from panchroma.offline.stages import luminance as constants
from panchroma.shared.arrays import BoolArray, DoubleArray

# Analysis reads l[n-3..n], the box one coefficient more on both sides, synthesis reads coefficients
# n..n+3.
REACH = 4


def filters() -> list[tuple[DoubleArray, DoubleArray]]:
    """Taps down and across of the decomposition filters f_i, the low-pass one first; sum_i |f_i|^2
    = 1 at every frequency.
    """
    wavelet = pywt.Wavelet("db2")
    low, high = np.array(wavelet.dec_lo) / math.sqrt(2), np.array(wavelet.dec_hi) / math.sqrt(2)
    return [(down, across) for down in (low, high) for across in (low, high)]


def convolved(picture: DoubleArray, down: DoubleArray, across: DoubleArray) -> DoubleArray:
    """The picture convolved with a separable filter, where that reads no pixel beyond the
    picture.
    """
    return convolve2d(picture, np.outer(down, across), "valid")


def start(signal: DoubleArray, measured: BoolArray, *, around: bool) -> DoubleArray:
    """l_0: the samples; or else in every hole the mean of the panchromatic samples around it."""
    if not around:
        return signal
    total, weight = (
        gaussian_filter(plane, constants._AROUND, mode="mirror")
        for plane in (np.where(measured, signal, 0), measured.astype(np.float64))
    )
    return np.where(measured, signal, total / weight)


def first_threshold(signal: DoubleArray, threshold: float, *, relative: bool = False) -> float:
    """What iterations begin with: the setting, and more where the frame is brighter than 3 scene
    units.

    relative: a multiple of the brightest sample instead.
    """
    if relative:
        return threshold * float(signal.max())
    return max(threshold, (float(signal.max()) - 1) / 2) if signal.max() > 3 else threshold


def analyse(picture: DoubleArray) -> list[DoubleArray]:
    """omega_i = f_i * l on the mirrored picture; one row and column wider than synthesis needs, for
    the box of Eq. 5.
    """
    wide = np.pad(picture, REACH, mode="reflect")
    return [convolved(wide, *taps) for taps in filters()]


def neighbourhood(subband: DoubleArray) -> DoubleArray:
    """[(k * omega^2)[n]]^(1/2) of Eq. 2; k is a 3 x 3 box of ones."""
    return np.sqrt(convolved(subband**2, np.ones(3), np.ones(3)))


def shrink(subband: DoubleArray, threshold: float) -> DoubleArray:
    """Shrink a subband by Eq. 5; a coefficient without energy around it is zero and stays zero."""
    size = neighbourhood(subband)
    less = np.maximum(size - threshold, 0)
    factor = np.divide(less, size, out=np.zeros_like(size), where=size > 0)
    return factor * subband[1:-1, 1:-1]


def synthesise(subbands: list[DoubleArray]) -> DoubleArray:
    """The transpose of the analysis, which inverts it because the frame is tight."""
    planes = [
        convolved(subband, down[::-1], across[::-1])
        for subband, (down, across) in zip(subbands, filters(), strict=True)
    ]
    return np.sum(planes, axis=0)


def objective(picture: DoubleArray) -> float:
    """Eq. 1 with Eq. 2, summed over the frame and the one ring around it that the coefficients of
    its pixels reach.
    """
    return float(sum(neighbourhood(subband).sum() for subband in analyse(picture)[1:]))


def recover(
    samples: DoubleArray, measured: BoolArray, iterations: int, decay: float, threshold: float
) -> DoubleArray:
    """Luminance after all iterations of Eqs. 3-5, (H, W). measured: True at panchromatic pixels."""
    estimate = samples.copy()  # l_0 = m
    for t in range(iterations):
        low, *high = analyse(estimate)
        shrunk = (shrink(subband, threshold * decay**t) for subband in high)
        denoised = synthesise([low[1:-1, 1:-1], *shrunk])  # Eq. 4
        estimate = np.where(measured, samples, denoised)  # Eq. 3
    return estimate
