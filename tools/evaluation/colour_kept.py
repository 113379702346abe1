"""What part of its colour a picture keeps, from the darkest to the brightest places: what fades there, no PSNR shows."""

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.white_balance import shades_of_grey

from .metrics import BORDER

PLACES = {"darkest tenth": 0.1, "to a quarter": 0.25, "to a half": 0.5, "to three quarters": 0.75, "brightest": 1.0}
"""The bins, and the quantile of the truth's luminance at which each ends."""
_BLUR = 8.0  # pixels: no fine detail is left, and hardly any noise
_LEAST = 3 * 0.03 / (2 * np.pi**0.5 * _BLUR)  # scene units: three standard errors of such a mean at a sigma of 0.03
_DARKEST = 1e-6  # scene units: a channel without light needs no balance


def colour_kept(rendered: FloatArray, truth: FloatArray) -> DoubleArray:
    """Sums over the pixels of each bin, float64 (2, 5): rendered colour times true colour, and true colour squared.

    Their ratio, also of the sums of several pictures, is the slope of the rendered colour on the true one: 1 is right, 0 is grey.
    Colour is what remains of the channels without their mean, in pictures that are white balanced (shades of grey of the truth) and
    blurred by a Gaussian. Pixels with hardly any colour, and `BORDER` pixels at each side, are left out.

    rendered, truth: (H, W, 3), linear, scene units.
    """
    from scipy.ndimage import gaussian_filter

    white = np.maximum(shades_of_grey(truth) or truth.mean(axis=(0, 1), dtype=np.float64), _DARKEST)
    balanced = [picture * (white.mean() / white) for picture in (rendered, truth)]
    inner = (slice(BORDER, -BORDER),) * 2
    seen, true = (gaussian_filter(each, _BLUR, axes=(0, 1))[inner] for each in balanced)
    luminance = true.mean(axis=2)
    seen, true = seen - seen.mean(axis=2, keepdims=True), true - luminance[..., None]
    coloured = np.square(true).mean(axis=2) > _LEAST**2
    place = np.searchsorted(np.quantile(luminance, list(PLACES.values())[:-1]), luminance[coloured])
    products = ((first * true).sum(axis=2)[coloured] for first in (seen, true))
    return np.stack([np.bincount(place, each, len(PLACES)) for each in products])
