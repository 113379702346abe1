"""Whether a picture knows how far it is off: how often errors lie within what it states, and whether that foretells wrong hues."""

import numpy as np

from shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray, strips
from shared.colour_difference import delta_e_2000

from .hue import balance, lab
from .metrics import BORDER

PARTS = ("luminance", "colour")
KINDS = ("flat places", "edges", "fine colour")
WITHIN = (1, 2)
KIND_ENDS = ("", *(f"_{kind.replace(' ', '_')}" for kind in KINDS))
"""Ends of the names of figures: of all places, then of each kind."""
_REACH = 2  # pixels: a place is 5 x 5 of them
# Scene units: standard deviation of colour in a place of fine colour, and of the sum of the channels at an edge. Both are three
# times what the noise of a camera's own photographs reaches.
_FINE, _EDGE = 0.02, 0.06
BINS = 120
"""Number of bins in which `histograms` counts pixels by their score."""
_PER_DECADE, _LEAST = 30.0, 0.01  # bins, and CIEDE2000 of the first
_DARK = 1e-4  # scene units: luminance below which a share of it says nothing


def kinds(truth: FloatArray) -> ByteArray:
    """What a place is, an index of KINDS, (H, W). truth: (H, W, C), scene units."""
    light = truth.sum(axis=2, dtype=np.float64)
    colour = truth - light[..., None] / truth.shape[2]
    fine = sum(_variance(plane) for plane in np.moveaxis(colour, 2, 0)) > _FINE**2
    return np.where(fine, 2, _variance(light) > _EDGE**2).astype(np.uint8)


def coverage(rendered: FloatArray, truth: FloatArray, stated: FloatArray) -> DoubleArray:
    """Errors within one and two stated standard deviations, and all errors: numbers by part and kind, float64 (2, 3, 3).

    rendered, truth: (H, W, C), scene units. stated: (H, W, 1 + C), see `offline.Rendering.uncertainty`; what is stated as exact is
    left out, and `BORDER` pixels at each side.
    """
    inner, wrong = (slice(BORDER, -BORDER),) * 2, rendered - truth
    light = wrong.sum(axis=2, keepdims=True)
    errors = np.abs(np.concatenate([light, wrong - light / wrong.shape[2]], axis=2))[inner]
    place, limits, found = kinds(truth)[inner], stated[inner], np.zeros((len(PARTS), len(KINDS), len(WITHIN) + 1))
    for plane in range(errors.shape[2]):
        for kind in range(len(KINDS)):
            here = (place == kind) & (limits[..., plane] > 0)
            counts = [np.count_nonzero(here & (errors[..., plane] <= times * limits[..., plane])) for times in WITHIN]
            found[min(plane, 1), kind] += [*counts, np.count_nonzero(here)]
    return found


def foretold(rendered: FloatArray, truth: FloatArray, stated: FloatArray) -> FloatArray:
    """How far pixels may be off, CIEDE2000, if they are off by one stated standard deviation; float32 (H, W).

    All three are shown as in `wrong_hue`. It is the root of the mean square over errors of luminance and of each channel's colour.
    """
    gain, found = balance(truth), np.empty(truth.shape[:2], np.float32)
    for rows in strips(len(truth)):
        picture, sigma = rendered[rows], stated[rows]
        light = picture.sum(axis=2, keepdims=True)
        changes = [picture * np.minimum(sigma[..., :1] / np.maximum(light, _DARK), 1)]
        for channel in range(3):
            change = np.repeat(-sigma[..., 1 + channel, None] / 2, 3, axis=2)
            change[..., channel] *= -2
            changes.append(change * np.float32((2 / 3) ** 0.5))
        seen = lab(gain * picture)
        squares = sum(np.square(delta_e_2000(seen, lab(gain * (picture + change)))) for change in changes)
        found[rows] = np.sqrt(squares)
    return found


def histograms(score: FloatArray, wrong: BoolArray) -> DoubleArray:
    """How often right and wrong pixels have each score, float64 (2, bins): of several pictures they add up."""
    bins = (_PER_DECADE * np.log10(np.maximum(score, _LEAST) / _LEAST)).clip(0, BINS - 1).astype(np.intp)
    return np.stack([np.bincount(bins[wrong == which], minlength=BINS).astype(np.float64) for which in (False, True)])


def area(found: DoubleArray) -> float | None:
    """Area under the ROC curve: how often a wrong pixel has a higher score than a right one; None without wrong or right ones."""
    right, wrong = found
    if not (right.sum() and wrong.sum()):
        return None
    return float((wrong * (np.cumsum(right) - right / 2)).sum() / (right.sum() * wrong.sum()))


def _variance(plane: DoubleArray) -> DoubleArray:
    from scipy.ndimage import uniform_filter

    mean, square = (uniform_filter(each, 2 * _REACH + 1, mode="mirror") for each in (plane, np.square(plane)))
    return np.maximum(square - np.square(mean), 0)
