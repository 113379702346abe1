"""Where a picture shows a wrong hue: what a person sees first, and a median over patches hides."""

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, strips
from shared.colorimetry import SRGB_TO_XYZ, xyz_to_lab
from shared.colour_difference import delta_e_2000

WRONG = 10.0  # CIEDE2000: seen at a glance, side by side or not
_BRIGHT, _BRIGHT_SHARE = 0.9, 0.99  # luminance that this quantile of the truth is shown with; 1 = white
_DARKEST = 1e-6  # scene units: a channel without light needs no balance


def wrong_hue(rendered: FloatArray, truth: FloatArray) -> BoolArray:
    """Pixels whose colour is more than WRONG from the truth, in CIEDE2000, as a screen would show both; bool (H, W).

    Both are shown alike: the truth's mean is balanced to grey, 99 % of its luminance lies below 0.9 of white, the channels count as
    primaries of sRGB, and what is beyond black or white is clipped.

    rendered, truth: (H, W, 3), linear, scene units.
    """
    gain, wrong = balance(truth), np.empty(truth.shape[:2], bool)
    for rows in strips(len(truth)):  # the formula needs two hundred bytes a pixel
        wrong[rows] = delta_e_2000(lab(gain * rendered[rows]), lab(gain * truth[rows])) > WRONG
    return wrong


def displayed(picture: FloatArray, truth: FloatArray) -> FloatArray:
    """A picture as `wrong_hue` shows it, float32 (H, W, 3), CIELAB."""
    gain, shown = balance(truth), np.empty(picture.shape, np.float32)
    for rows in strips(len(picture)):
        shown[rows] = lab(gain * picture[rows])
    return shown


def balance(truth: FloatArray) -> DoubleArray:
    """Gains of the channels, (3,), with which `wrong_hue` shows pictures."""
    mean = np.maximum(truth.mean(axis=(0, 1), dtype=np.float64), _DARKEST)
    gain = mean.mean() / mean  # white balance
    luminance = truth @ (gain * SRGB_TO_XYZ[1])
    return gain * _BRIGHT / max(float(np.quantile(luminance, _BRIGHT_SHARE)), _DARKEST)


def lab(balanced: DoubleArray) -> DoubleArray:
    """CIELAB of balanced linear sRGB, (..., 3); what is beyond black or white is clipped."""
    return xyz_to_lab(np.clip(balanced, 0.0, 1.0) @ np.array(SRGB_TO_XYZ).T)
