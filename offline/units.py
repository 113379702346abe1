"""Frames have to measure luminance, in scene units, whose white is about 1, and every picture is checked to be finite.

Stages have thresholds in scene units, such as the luminance below which a pixel has no colour: samples in another unit would give
a wrong picture without a word.
"""

from collections.abc import Sequence
from math import frexp

import numpy as np

from shared.arrays import FloatArray
from shared.errors import InputError, RangeError
from shared.mosaic import Mosaic

_FARTHEST = 2.0**10
"""Times white, or a fraction of it: the brightest sample of a frame in scene units lies within."""


def check_frames(mosaics: Sequence[Mosaic]) -> None:
    """Raise InputError for frames without a panchromatic pixel, and for those of floating point that are not in scene units.

    The message says by what to scale the latter. Codes always are: their calibration says what they mean, and a lens cap makes
    frames as dark as can be. So a dark frame is taken if its brightest sample is half a code of its sensor, and a black one too.
    """
    for mosaic in mosaics:
        height, width = mosaic.shape
        if not mosaic.pattern.panchromatic_mask((min(height, mosaic.pattern.period), min(width, mosaic.pattern.period))).any():
            raise InputError(
                f"a frame of {width} x {height} pixels without a panchromatic one does not measure luminance; use a larger one"
            )
    if any(mosaic.samples.dtype == np.uint16 for mosaic in mosaics):
        return
    calibration = mosaics[0].calibration
    brightest = max(max(-float(mosaic.samples.min()), float(mosaic.samples.max())) for mosaic in mosaics) / calibration.full_scale
    least = min(1 / _FARTHEST, 0.5 * float(calibration.scale().min()) / calibration.full_scale)
    if brightest and not least <= brightest <= _FARTHEST:
        factor = 2.0 ** -frexp(brightest)[1]
        raise InputError(
            f"the brightest sample is {brightest:.2g} times white, expected {least:.2g} to {_FARTHEST:g}: it is not in scene "
            f"units, whose white is about 1; multiply the samples, and their noise, by {factor:.3g}"
        )


def check_finite(picture: FloatArray, first: int) -> None:
    """Raise RangeError if a value of a band of a picture, (rows, W, C), is not finite. first: the frame's row that is its first."""
    with np.errstate(over="ignore"):
        if np.isfinite(picture.sum()):
            return
    wrong = ~np.isfinite(picture).all(axis=2)
    if wrong.any():
        row, column = np.argwhere(wrong)[0].tolist()
        raise RangeError(
            f"{np.count_nonzero(wrong)} pixels of the picture are not finite (NaN or infinite), the first in row {first + row}, "
            f"column {column}; this is a fault of the render: please report the shot and the settings"
        )
