"""Where a stroke or a small object of one colour shows several: what a person minds more than one colour that is a little off."""

import numpy as np

from shared.arrays import BoolArray, FloatArray

from .hue import displayed

UNEVEN = 10.0  # distance in the plane of CIELAB a*, b*: seen at a glance within one word
_SAME = 5.0  # CIELAB distance of two true colours that count as one
_STEP, _STEPS = 3, 2  # pixels between the places that are compared with, and how many to either side: as far as letters are wide
_FEWEST = 3.0  # of these 25 places must have a pixel's own colour: a pixel along an edge is of no colour


def uneven_hue(rendered: FloatArray, truth: FloatArray) -> BoolArray:
    """Pixels whose error of hue and chroma (a*, b*) is not that of the pixels around with the same true colour; bool (H, W).

    An error that all of a small object shares is none here. Both pictures are shown as in `wrong_hue`.
    rendered, truth: (H, W, 3), linear, scene units.
    """
    seen, true = displayed(rendered, truth), displayed(truth, truth)
    error, reach = (seen - true)[..., 1:], _STEP * _STEPS
    (height, width), total = error.shape[:2], np.zeros_like(error)
    count = np.zeros((height, width, 1), np.float32)
    wide_error, wide_true = (np.pad(each, ((reach, reach), (reach, reach), (0, 0)), "reflect") for each in (error, true))
    for down in range(0, 2 * reach + 1, _STEP):
        for right in range(0, 2 * reach + 1, _STEP):
            place = slice(down, down + height), slice(right, right + width)
            same = (np.square(wide_true[place] - true).sum(axis=2, keepdims=True) < _SAME**2).astype(np.float32)
            total += same * wide_error[place]
            count += same
    apart = np.square(error - total / count).sum(axis=2)
    return (apart > UNEVEN**2) & (count[..., 0] >= _FEWEST)
