"""Wrong hues and faded colours, which medians over patches hide."""

import numpy as np

from ...shared.arrays import BoolArray, DoubleArray, FloatArray, strips
from ...shared.colorimetry import SRGB_TO_XYZ
from ...shared.white_balance import shades_of_grey
from ..io.colour import xyz_to_lab
from ..io.colour_difference import delta_e_2000
from .metrics import BORDER

WRONG = 10.0  # CIEDE2000: seen at a glance, side by side or not
# Luminance, 1 = white, that this quantile of the truth is shown with.
_BRIGHT, _BRIGHT_SHARE = 0.9, 0.99
_DARKEST = 1e-6  # scene units: a channel without light needs no balance
PLACES = (0.1, 0.25, 0.5, 0.75, 1.0)
"""The quantile of the truth's luminance at which each bin ends."""
_BLUR = 8.0  # pixels: no fine detail is left, and hardly any noise
# Scene units: three standard errors of such a mean at a sigma of 0.03.
_LEAST_COLOUR = 3 * 0.03 / (2 * np.pi**0.5 * _BLUR)
_LEAST_PIXELS = 0.05  # of a bin: fewer with colour say nothing about it
_SQUARE = 48  # pixels: side of the squares whose errors count as independent
SUMS = 7, len(PLACES)
"""Shape of what `colour_kept` returns."""


def wrong_hue(rendered: FloatArray, truth: FloatArray) -> BoolArray:
    """Pixels whose colour is more than WRONG from the truth, in CIEDE2000, as a screen would show
    both; bool (H, W).

    Both are shown alike: the truth's mean is balanced to grey, 99 % of its luminance lies below 0.9
    of white, the channels count as primaries of sRGB, and what is beyond black or white is clipped.

    rendered, truth: (H, W, 3), linear, scene units.
    """
    gain, wrong = _balance(truth), np.empty(truth.shape[:2], bool)
    for rows in strips(len(truth)):  # the formula needs two hundred bytes a pixel
        wrong[rows] = delta_e_2000(_lab(gain * rendered[rows]), _lab(gain * truth[rows])) > WRONG
    return wrong


def colour_kept(rendered: FloatArray, truth: FloatArray) -> DoubleArray:
    """Sums over the pixels of each bin, float64 (7, 5): rendered colour times true colour, r, and
    true colour squared, t; r^2, r t and t^2 of the sums over squares of 48 pixels; the number of
    pixels with colour, and of all.

    Those of several pictures add up; `colour_slopes` has the result. Colour is what remains of the
    channels without their mean, in pictures that are white balanced (shades of grey of the truth)
    and blurred by a Gaussian. Pixels with hardly any colour, and `BORDER` pixels at each side, are
    left out.

    rendered, truth: (H, W, 3), linear, scene units.
    """
    from scipy.ndimage import gaussian_filter

    white = np.maximum(shades_of_grey(truth) or truth.mean(axis=(0, 1), dtype=np.float64), _DARKEST)
    balanced = [picture * (white.mean() / white) for picture in (rendered, truth)]
    inner = (slice(BORDER, -BORDER),) * 2
    blurred = [gaussian_filter(picture, _BLUR, axes=(0, 1))[inner] for picture in balanced]
    luminance = blurred[1].mean(axis=2)
    colours = [picture - picture.mean(axis=2, keepdims=True) for picture in blurred]
    coloured = np.square(colours[1]).mean(axis=2) > _LEAST_COLOUR**2
    place = np.searchsorted(np.quantile(luminance, PLACES[:-1]), luminance)
    down, across = (np.arange(size) // _SQUARE for size in place.shape)
    square = down[:, None] * (across[-1] + 1) + across
    products = [(colour * colours[1]).sum(axis=2) * coloured for colour in colours]
    bins, length = (square * len(PLACES) + place).ravel(), (square[-1, -1] + 1) * len(PLACES)
    planes = (*products, coloured, np.ones(place.shape))
    sums = [np.bincount(bins, plane.ravel(), length) for plane in planes]
    r, t, count, whole = np.reshape(sums, (len(sums), -1, len(PLACES)))
    return np.stack([plane.sum(axis=0) for plane in (r, t, r * r, r * t, t * t, count, whole)])


def colour_slopes(sums: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Slope of the rendered colour on the true one in each bin, and its standard error, float64
    (5,); NaN where less than 5 % of the pixels have colour, or where nothing is known of an error.

    1 is right, 0 is grey. The error is that of a ratio of sums over independent squares.

    sums: what `colour_kept` returns, also of several pictures.
    """
    *products, coloured, pixels = sums
    known = coloured >= np.maximum(_LEAST_PIXELS * pixels, 1)
    rendered, true, square, product, energy = np.where(known, products, np.nan)
    slope, number = rendered / true, true**2 / energy  # of squares, as if all had as much colour
    variance = np.maximum(square - 2 * slope * product + slope**2 * energy, 0) / true**2
    return slope, np.sqrt(variance * number / np.where(number > 1.5, number - 1, np.nan))


def _balance(truth: FloatArray) -> DoubleArray:
    """Gains of the channels, (3,), with which `wrong_hue` shows pictures."""
    mean = np.maximum(truth.mean(axis=(0, 1), dtype=np.float64), _DARKEST)
    gain = mean.mean() / mean  # white balance
    luminance = truth @ (gain * SRGB_TO_XYZ[1])
    return gain * _BRIGHT / max(float(np.quantile(luminance, _BRIGHT_SHARE)), _DARKEST)


def _lab(balanced: DoubleArray) -> DoubleArray:
    """CIELAB of balanced linear sRGB, (..., 3); what is beyond black or white is clipped."""
    return xyz_to_lab(np.clip(balanced, 0.0, 1.0) @ np.array(SRGB_TO_XYZ).T)
