"""Demosaicking by directional linear minimum mean square-error estimation: the rival of the paper's
section 4.

L. Zhang, X. Wu, "Color demosaicking via directional linear minimum mean square-error estimation",
IEEE Transactions on Image Processing 14(12), 2005. Green minus red (or blue) varies slowly.
Horizontal and vertical interpolation give two noisy estimates of it. Each is denoised, the two are
averaged by their expected errors, and red and blue follow from interpolated differences.
"""

from functools import partial

import numpy as np

from ....shared.arrays import DoubleArray, FloatArray
from ...simulation.bayer import channel_map
from ..cameras import Method, render_samples

_GREEN = 1
# Second-order interpolation of the missing colour along a line (section II; after Hamilton and
# Adams).
_INTERPOLATION = np.array([-1, 2, 2, 2, -1]) / 4
# The low-pass that separates signal from noise: close to a Gaussian of 2 pixels.
_LOW_PASS = np.array([4, 9, 15, 23, 26, 23, 15, 9, 4]) / 128
_WINDOW = 9  # pixels along the line, for the local moments
# Not uniform_filter1d: the rounding errors of its running sums would enter the variances.
_MEAN = np.full(_WINDOW, 1 / _WINDOW)
# Added to variances: keeps flat patches defined, and is far below a step of 8 bits.
_FLOOR = 0.1 / 255**2
_DIAGONAL = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]]) / 4
_AXIAL = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4


def demosaic_dlmmse(mosaic: FloatArray) -> FloatArray:
    """Picture, float32 (H, W, 3), from a Bayer mosaic (H, W), both in scene units. Measured samples
    are kept.
    """
    from scipy.ndimage import correlate

    samples = mosaic.astype(np.float64)
    colour = channel_map(mosaic.shape)
    green_site = colour == _GREEN
    horizontal, horizontal_error = _directional_estimate(samples, green_site, axis=1)
    vertical, vertical_error = _directional_estimate(samples, green_site, axis=0)
    joined = vertical_error * horizontal + horizontal_error * vertical
    joined /= horizontal_error + vertical_error

    green = np.where(green_site, samples, samples + joined)
    rgb = np.empty((*mosaic.shape, 3))
    rgb[..., _GREEN] = green
    for channel in (0, 2):
        # Green minus this colour, where it is measured.
        difference = np.where(colour == channel, green - samples, 0.0)
        other = colour == 2 - channel
        difference[other] = correlate(difference, _DIAGONAL, mode="mirror")[other]
        difference[green_site] = correlate(difference, _AXIAL, mode="mirror")[green_site]
        rgb[..., channel] = green - difference
        rgb[..., channel][colour == channel] = samples[colour == channel]  # not its rounded sum
    return rgb.astype(np.float32)


def _directional_estimate(
    samples: DoubleArray, green_site: np.ndarray, axis: int
) -> tuple[DoubleArray, DoubleArray]:
    """Green minus the other colour of the line at every pixel, and its expected squared error."""
    from scipy.ndimage import correlate1d

    def filtered(values: DoubleArray, weights: DoubleArray) -> DoubleArray:
        return correlate1d(values, weights, axis, mode="mirror")

    interpolated = filtered(samples, _INTERPOLATION)
    reading = np.where(green_site, samples - interpolated, interpolated - samples)
    smooth = filtered(reading, _LOW_PASS)
    # Unbiased variance of the smooth signal, and power of what the low-pass removed as noise.
    variance = np.maximum(filtered(smooth**2, _MEAN) - filtered(smooth, _MEAN) ** 2, 0)
    signal = variance * _WINDOW / (_WINDOW - 1)
    noise = filtered((smooth - reading) ** 2, _MEAN) + _FLOOR
    gain = signal / (signal + noise)
    # The smooth signal takes the place of the local mean, as in the authors' program; the paper's
    # text has the moving mean.
    return smooth + gain * (reading - smooth), signal * (1 - gain) + _FLOOR


_render = partial(render_samples, demosaic_dlmmse)
METHODS = (
    Method("dlmmse", "Bayer, DLMMSE 2005", _render),
    Method("dlmmse-wb", "Bayer, DLMMSE, balanced", _render, balanced=True),
)
